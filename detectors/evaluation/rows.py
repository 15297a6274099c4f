"""Rows of a study: which fault, how it runs, what the sensors see, and which answer is right."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from detectors.evaluation.ground_runs import GroundRuns
from detectors.evaluation.reality import Course
from detectors.evaluation.sensing import Sensing
from detectors.words.verdict import State

LEAKS = ("slippers", "slippers", "three slippers", "three pistons", "port plate", "port plate", "slippers", "slippers")
"""Half slippers, a quarter three slippers or three pistons, a quarter port plates."""


class Faults(Protocol):
    """How the faults of a row run; plain data, so that a task can be sent to another process and named by its text."""

    @property
    def onset(self) -> int | None:
        """First flight with a fault; None without one."""
        ...

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        """Faults of one chunk of pumps."""
        ...


@dataclass(frozen=True, slots=True)
class NoFault:
    """Healthy pumps."""

    onset: int | None = None

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        return ()


@dataclass(frozen=True, slots=True)
class Growing:
    """Grows linearly to ``amount`` over ``flights`` from ``onset``; kinds take turns over the chunks."""

    kinds: tuple[str, ...]
    amount: float
    flights: int = 150
    onset: int = 40

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        # the onset's own flight already carries the first bit
        size = self.amount * np.clip((np.arange(n_flights) - self.onset + 1) / self.flights, 0.0, 1.0)
        return (Course(self.kinds[chunk % len(self.kinds)], np.tile(size, (n_pumps, 1))),)


@dataclass(frozen=True, slots=True)
class WearingOut:
    """Grows to ``amount`` over ``flights`` from ``onset``, linearly or by ``exp(growth)`` in pace; both take turns."""

    kinds: tuple[str, ...]
    amount: float
    flights: int = 290
    onset: int = 10
    growths: tuple[float, ...] = (0.0, 2.0)

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        run = np.clip((np.arange(n_flights) - self.onset + 1) / self.flights, 0.0, 1.0)
        growth = self.growths[chunk // len(self.kinds) % len(self.growths)]
        share = np.expm1(growth * run) / np.expm1(growth) if growth else run
        return (Course(self.kinds[chunk % len(self.kinds)], np.tile(self.amount * share, (n_pumps, 1))),)


@dataclass(frozen=True, slots=True)
class Stepping:
    """There with its full ``amount`` from flight ``onset`` on; kinds take turns over the chunks."""

    kinds: tuple[str, ...]
    amount: float
    onset: int = 40

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        size = self.amount * (np.arange(n_flights) >= self.onset)
        return (Course(self.kinds[chunk % len(self.kinds)], np.tile(size, (n_pumps, 1))),)


@dataclass(frozen=True, slots=True)
class ComingAndGoing:
    """There with its full ``amount`` for ``on`` flights from ``onset`` on, gone for ``off``, there again."""

    kinds: tuple[str, ...]
    amount: float
    on: int = 25
    off: int = 15
    onset: int = 40

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        since = np.arange(n_flights) - self.onset
        size = self.amount * ((since >= 0) & (since % (self.on + self.off) < self.on))
        return (Course(self.kinds[chunk % len(self.kinds)], np.tile(size, (n_pumps, 1))),)


@dataclass(frozen=True, slots=True)
class OnSomeFlights:
    """There with its full ``amount`` on a ``share`` of the flights from ``onset`` on, drawn flight by flight."""

    kinds: tuple[str, ...]
    amount: float
    share: float = 0.5
    onset: int = 40

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        drawn = np.random.default_rng((chunk, self.onset, n_pumps)).uniform(size=(n_pumps, n_flights)) < self.share
        size = np.where(drawn & (np.arange(n_flights) >= self.onset), self.amount, 0.0)
        return (Course(self.kinds[chunk % len(self.kinds)], size),)


@dataclass(frozen=True, slots=True)
class SmallStep:
    """Steps in inside the judge's own world (``detectors.evaluation.small_steps``) and stays.

    ``kind`` is one of ``hypotheses.FAULT_KINDS``; ``information`` what it gives away in the mean [nat a record] while
    it is looked for: its size follows from that, pump by pump.
    """

    kind: str
    information: float = 0.2
    onset: int = 60

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        return ()


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Faults at the same time; the first one is the larger."""

    faults: tuple[Growing | Stepping, ...]

    @property
    def onset(self) -> int | None:
        return min(f.onset for f in self.faults)

    def courses(self, n_pumps: int, n_flights: int, chunk: int) -> tuple[Course, ...]:
        return tuple(c for f in self.faults for c in f.courses(n_pumps, n_flights, chunk))


@dataclass(frozen=True, slots=True)
class Row:
    """What one row of a study simulates.

    Attributes
    ----------
    truth
        The state that is right at the end; of two faults the larger one's; ``healthy`` without a fault of pump,
        system or sensor.
    unit
        Of the size of the (first) fault.
    worn
        Pumps arrive with a case flow at the reference above 2.2 L/min.
    by_records
        Sized by healthy records in each reality instead of by pumps: false alarms are counted per record.
    moved_at
        Flight from which the pump sits in another aircraft, with that one's drain, sensors and climate; what has
        worn stays worn.
    limit
        Case flow at the reference [L/min] on the way to which forecasts are asked; None: none are.
    """

    name: str
    truth: State
    n_flights: int = 200
    course: Faults = field(default_factory=NoFault)
    unit: str = ""
    sensing: Sensing = field(default_factory=Sensing)
    worn: bool = False
    by_records: bool = False
    moved_at: int | None = None
    limit: float | None = None

    @property
    def onset(self) -> int | None:
        """First flight on which something is wrong; None for pumps that stay healthy."""
        if self.worn:
            return 0
        return self.sensing.step_at if self.sensing.has_fault else self.course.onset

    @property
    def is_single(self) -> bool:
        """Whether exactly one answer is right: no second fault beside the first."""
        return not isinstance(self.course, SideBySide)

    @property
    def is_pooled(self) -> bool:
        """Whether the row is one of those that calibration and confusion are counted over: others say the same twice."""
        return self.is_single and not self.in_class and self.sensing.ground_runs is None

    @property
    def in_class(self) -> bool:
        """Whether the world is the judge's own, which says nothing of other worlds: such rows are never pooled."""
        return isinstance(self.course, SmallStep)


HEALTHY = "healthy"
_CASE_ZERO = Sensing(case_zero_step=0.06, step_at=40)
SMALL_STEP = "small step: "
SMALL_STEP_KINDS = {
    "leakage, slippers": (State.PUMP_DEGRADATION, "L/min"),
    "setting": (State.COMPENSATOR_FAULT, "bar"),
    "system leakage": (State.SYSTEM_LEAKAGE, "L/min"),
    "drain restriction": (State.DRAIN_RESTRICTION, "-"),
}
_SMALL_STEPS = tuple(
    Row(SMALL_STEP + kind, state, 200, SmallStep(kind), unit) for kind, (state, unit) in SMALL_STEP_KINDS.items()
)
LIFE, LONG_LIFE = "life to the limit of 1.5 L/min", "life to a limit of 2.5 L/min"
"""The acceptance sheet's limit lies 0.2 L/min above the nominal pump, little more than the error of the case flow; the
other one several times as far."""
_EVEN = ("slippers", "port plate")
_AFTER_MOVE = Growing(LEAKS, 0.6, flights=115, onset=80)
_INTERMITTENT = ComingAndGoing(("system",), 3.0)
"""Four spells of 25 flights with 15 between them; the last one stands at the end."""
PLAIN_ROWS: tuple[Row, ...] = (
    Row(HEALTHY, State.HEALTHY, 250, by_records=True),
    Row("pump leakage 0.6 L/min", State.PUMP_DEGRADATION, 200, Growing(LEAKS, 0.6), "L/min"),
    Row("uneven wear", State.PUMP_DEGRADATION, 200, Growing(("three pistons", "one slipper"), 0.15), "L/min"),
    Row("system leakage 3 L/min", State.SYSTEM_LEAKAGE, 200, Growing(("system",), 3.0), "L/min"),
    Row("drain +30 %", State.DRAIN_RESTRICTION, 120, Stepping(("drain",), 0.3), "-"),
    Row("setting 1.5 bar", State.COMPENSATOR_FAULT, 200, Growing(("setting",), -1.5), "bar"),
    Row("setting 3 bar", State.COMPENSATOR_FAULT, 200, Growing(("setting",), -3.0), "bar"),
    Row("edge radius x10", State.COMPENSATOR_FAULT, 200, Growing(("erosion",), 45.0), "um"),
    Row(
        "edge radius x10, closed-centre valve",
        State.COMPENSATOR_FAULT,
        200,
        Growing(("erosion, closed-centre valve",), 45.0),
        "um",
    ),
    Row("jamming, sticking spool", State.COMPENSATOR_FAULT, 200, Growing(("sticking spool",), 5.0), "N"),
    Row("jamming, stuck spool", State.COMPENSATOR_FAULT, 200, Stepping(("stuck spool",), 500.0), "N"),
    Row("case zero +0.06 bar", State.SENSOR_FAULT, 120, sensing=_CASE_ZERO),
    Row(
        "case zero +0.06 bar, zero not measured",
        State.SENSOR_FAULT,
        120,
        sensing=replace(_CASE_ZERO, zero_measured=False),
    ),
    Row("reservoir +1 bar", State.HEALTHY, 120, Stepping(("reservoir",), 1.0), "bar"),
    Row(
        "reservoir +1 bar, reservoir not measured",
        State.HEALTHY,
        120,
        Stepping(("reservoir",), 1.0),
        "bar",
        Sensing(reservoir_measured=False),
    ),
    Row("reservoir not measured", State.HEALTHY, 120, sensing=Sensing(reservoir_measured=False)),
    Row("pump exchanged", State.HEALTHY, 200, moved_at=100),
    Row("pump leakage 0.6 L/min, exchanged", State.PUMP_DEGRADATION, 200, _AFTER_MOVE, "L/min", moved_at=60),
    Row("system leakage 3 L/min, comes and goes", State.SYSTEM_LEAKAGE, 185, _INTERMITTENT, "L/min"),
    Row(LIFE, State.PUMP_DEGRADATION, 300, WearingOut(_EVEN, 0.8), "L/min", limit=1.5),
    Row(LONG_LIFE, State.PUMP_DEGRADATION, 300, WearingOut(_EVEN, 1.6), "L/min", limit=2.5),
    Row("worn on arrival", State.PUMP_DEGRADATION, 30, worn=True),
    Row(
        "two faults: pump 0.6, system 1 L/min",
        State.PUMP_DEGRADATION,
        200,
        SideBySide((Growing(("slippers",), 0.6), Growing(("system",), 1.0))),
        "L/min",
    ),
    Row(
        "two faults: setting 3 bar, drain +30 %",
        State.COMPENSATOR_FAULT,
        200,
        SideBySide((Growing(("setting",), -3.0), Growing(("drain",), 0.3))),
        "bar",
    ),
    *_SMALL_STEPS,
)
BURST = "; burst"


def with_burst(rows: Sequence[Row]) -> tuple[Row, ...]:
    """The same rows with a burst of 2 s at 10 kHz in every zero-flow window."""
    return tuple(replace(r, name=r.name + BURST, sensing=replace(r.sensing, burst=True)) for r in rows)


GROUND_RUNS = "; ground runs"
"""Rows in which every tenth flight holds windows at 10 and 20 L/min behind the one at zero flow."""
_WITH_GROUND_RUNS = (HEALTHY, "pump leakage 0.6 L/min", "system leakage 3 L/min", "drain +30 %")
GROUND_RUN_ROWS: tuple[Row, ...] = tuple(
    replace(r, name=r.name + GROUND_RUNS, sensing=replace(r.sensing, ground_runs=GroundRuns(10)))
    for r in PLAIN_ROWS
    if r.name in _WITH_GROUND_RUNS
)
ROWS: tuple[Row, ...] = (*PLAIN_ROWS, *with_burst(PLAIN_ROWS), *GROUND_RUN_ROWS)
"""With one 1 Hz zero-flow window a flight, with a burst in it, and some with ground runs."""
