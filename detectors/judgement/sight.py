"""What a pump type's channels can part at all: without both pressures, or without a twin, causes look alike."""

from dataclasses import dataclass, replace

from detectors.judgement.isolation import Evidence
from detectors.words.verdict import FAULTS, State
from twin.parameters import PumpType


@dataclass(frozen=True, slots=True)
class Sight:
    """What records of a type lack from the start (``PumpType.lacks``), whether the type has a twin of its own, and whether
    its reservoir's pressure is known without a sensor.
    """

    lacks: tuple[str, ...] = ()
    own_twin: bool = True
    reservoir_known: bool = False

    @property
    def parts_causes(self) -> bool:
        """Whether causes can be told from each other, and levels be told at all."""
        return self.own_twin and not {"discharge_pressure_bar", "case_pressure_bar"}.intersection(self.lacks)


WHOLE_SIGHT = Sight()
"""Of a type with a twin whose records hold every channel."""


def alike_for(pump: PumpType) -> tuple[State, ...]:
    """Faults that nothing in the type's records parts; none where discharge and case pressure meet a twin.

    One pressure moves with all of them. A measured curve alone knows both pressures and no law: what moves the
    discharge pressure and leaves the case where it is has moved the setting, or a sensor; all else looks alike.
    """
    if not pump.has_both_pressures:
        return FAULTS
    return () if pump.own_twin else tuple(f for f in FAULTS if f is not State.COMPENSATOR_FAULT)


def blurred(found: Evidence, alike: tuple[State, ...]) -> Evidence:
    """The evidence with what cannot be parted counted alike: that something changed stays, which of them is open."""

    def even(shares: dict[State, float]) -> dict[State, float]:
        each = sum(shares[s] for s in alike) / len(alike)
        return shares | dict.fromkeys(alike, each)

    return replace(
        found,
        probabilities=even(dict(found.probabilities)),
        shares=even(dict(found.shares)),
        surely=even(dict(found.surely)),
        # how a pump came is a question of its level, which nothing shows
        arrival=0.0,
    )
