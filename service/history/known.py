"""Everything that a pump's verdicts are a function of: gathered here, folded above."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from detectors.expectation.type_correction import HealthyCurve
from detectors.judgement.handover import FromOthers
from detectors.words.flights import Outline
from detectors.words.observation import Maintenance, Observation
from service.history.setting import Setting
from twin.parameters import PumpType

Observations = Callable[[Sequence[str]], Mapping[str, Observation]]
"""Gives the observations of records: those that the fold needs, and no others."""
Others = Mapping[str, FromOthers]
"""What records take over from other pumps, by record, looked up as they are asked for; most take over nothing."""
ALONE: Others = {}


@dataclass(frozen=True, slots=True)
class PlacedRecord:
    """A record where the pump really sat, in its surroundings, without its numbers.

    ``digest`` stands for its reduction, ``flags`` are remarks on this record.
    """

    outline: Outline
    digest: str
    setting: Setting
    flags: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Known:
    """Everything that a pump's verdicts are a function of, apart from reductions and the twin's version.

    ``placed`` is in event order: by instant, then by record.
    ``remarks`` are on the pump itself, whatever its records say.
    ``borrowed`` names, by record, what that record takes over from other pumps.
    ``healthy`` is the pump type's measured curve that stands in for the twin's, None where nobody has measured one.
    """

    kind: PumpType
    thresholds: Mapping[str, float]
    placed: tuple[PlacedRecord, ...]
    maintenance: tuple[Maintenance, ...] = ()
    installation_changes: tuple[datetime, ...] = ()
    healthy: HealthyCurve | None = None
    remarks: tuple[str, ...] = ()
    borrowed: Mapping[str, tuple[object, ...]] = field(default_factory=dict)

    def healthy_in(self, setting: Setting) -> HealthyCurve | None:
        """The measured curve where it holds: it was measured with the pump type's own fluid."""
        return self.healthy if setting.has_own_fluid(self.kind) else None


def pieces(placed: Sequence[PlacedRecord]) -> list[tuple[int, int]]:
    """Stretches of equal settings as (start, end)."""
    settings = [p.setting for p in placed]
    starts = [i for i, setting in enumerate(settings) if i == 0 or setting != settings[i - 1]]
    return list(zip(starts, [*starts[1:], len(settings)], strict=True)) if starts else []
