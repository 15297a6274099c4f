"""What every hypothesis carries: the state, how it wanders in a healthy pump, and the faults that may move it.

A state vector holds what differs between pumps, aircraft and sensors (the nuisances, all alive, none frozen; see
``detectors.expectation.components``), one fault amplitude and that amplitude's change from record to record. The fault stands
inside the flows, not beside them: a big fault is not a small one times a slope.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.expectation.components import INDEX, N_COMPONENTS, N_STATE, PLACE
from detectors.words.verdict import State
from twin.parameters import PumpType

Array = NDArray[np.float64]

ONCE_PER_LEAKAGE = 1.1
"""Line at once per revolution in discharge pressure that unequal leakage draws [bar per L/min]: one slipper gap x 1.8
gives 260 mbar with 0.22 L/min, three pistons +150 % give 57 mbar with 0.056 L/min (own transient runs)."""


@dataclass(frozen=True, slots=True)
class FaultKind:
    """One way in which something can change, mostly for the worse: which components move with its amplitude, how far, in which direction.

    ``scale`` is the one-sigma size of a fault in the first component's unit; ``floor`` the size below which it is
    not worth a word and counts as healthy; ``sign`` is +1 when the amplitude can only be positive (a leak does
    not heal), 0 when both directions occur. ``sensor`` names the channel of a sensor fault. ``sudden`` and ``growing``
    are how much likelier than others it sets in at once or grows [nat]; None: never.
    ``beside`` names a second fault that comes with it: from the onset on the setting goes where it likes.
    """

    name: str
    state: State
    moves: tuple[tuple[str, float], ...]
    scale: float
    floor: float
    sign: int
    sensor: str | None = None
    sudden: float | None = 0.0
    growing: float | None = 0.0
    beside: State | None = None

    @property
    def component(self) -> str:
        """The component that the amplitude is counted in; empty where there is none."""
        return self.moves[0][0] if self.moves else ""


_WEARS = -1.6
"""Wear grows: one leak in five sets in at once, and pure orifices are rare among them (estimates) [nat]."""
_TWO = -4.0
"""Two faults that set in together, against one (estimate) [nat]."""
FAULT_KINDS: tuple[FaultKind, ...] = (
    FaultKind(
        "leakage, slippers", State.PUMP_DEGRADATION, (("slipper_extra", 1.0),), 0.4, 0.05, 1, sudden=_WEARS, growing=1.0
    ),
    FaultKind(
        "leakage, port plate",
        State.PUMP_DEGRADATION,
        (("laminar_extra", 1.0),),
        0.4,
        0.05,
        1,
        sudden=_WEARS,
        growing=1.0,
    ),
    FaultKind(
        "leakage, mixed",
        State.PUMP_DEGRADATION,
        (("slipper_extra", 0.5), ("throttled", 0.5)),
        0.4,
        0.05,
        1,
        sudden=_WEARS,
    ),
    FaultKind(
        "leakage, throttled",
        State.PUMP_DEGRADATION,
        (("throttled", 1.0),),
        0.4,
        0.05,
        1,
        sudden=2.0 * _WEARS,
        growing=_WEARS,
    ),
    FaultKind(
        "uneven wear",
        State.PUMP_DEGRADATION,
        (("slipper_extra", 1.0), ("once", ONCE_PER_LEAKAGE)),
        0.2,
        0.02,
        1,
        sudden=_WEARS,
    ),
    FaultKind("setting", State.COMPENSATOR_FAULT, (("setting", 1.0),), 2.0, 0.7, 0, sudden=1.0, growing=2.0),
    FaultKind("bleed", State.COMPENSATOR_FAULT, (("bleed", 1.0),), 0.2, 0.05, 1, sudden=_WEARS),
    FaultKind("system leakage, orifice", State.SYSTEM_LEAKAGE, (("system_orifice", 1.0),), 1.5, 0.3, 1),
    FaultKind("system leakage, laminar", State.SYSTEM_LEAKAGE, (("system_laminar", 1.0),), 1.5, 0.3, 1),
    FaultKind("drain restriction", State.DRAIN_RESTRICTION, (("ln_drain", 1.0),), 0.3, 0.06, 1),
    FaultKind("case sensor", State.SENSOR_FAULT, (("case_offset", 1.0),), 0.15, 0.06, 0, "case_pressure_bar"),
    FaultKind("fluid batch", State.HEALTHY, (("ln_viscosity", 1.0),), 0.06, 0.0, 0, sudden=2.3, growing=None),
    FaultKind(
        "drain restriction, setting moves",
        State.DRAIN_RESTRICTION,
        (("ln_drain", 1.0),),
        0.3,
        0.06,
        1,
        sudden=None,
        growing=_TWO,
        beside=State.COMPENSATOR_FAULT,
    ),
    FaultKind(
        "leakage, setting moves",
        State.PUMP_DEGRADATION,
        (("slipper_extra", 1.0),),
        0.4,
        0.05,
        1,
        sudden=None,
        growing=_TWO,
        beside=State.COMPENSATOR_FAULT,
    ),
    FaultKind("reservoir sensor", State.SENSOR_FAULT, (("reservoir", 1.0),), 0.5, 0.1, 0, "reservoir_pressure_bar"),
    FaultKind("fault gone", State.HEALTHY, (), 0.0, 0.0, 0, sudden=-1.0, growing=None),
)
"""Sizes are estimates: what is worth finding on an H225 and what the literature's rigs show. Settings drift more often than
pumps fail (and no healthy pump of the studies was ever taken for one); fluid is changed once in some hundred flights. That a fault is
gone must stay less likely than the alarm level is high: every new candidate would hold the alarm back."""
N_KINDS = len(FAULT_KINDS)
GONE = N_KINDS - 1
"""The kind that undoes the likeliest fault: it begins where that fault's filter stands, without the fault."""
LOG_HAZARD = float(np.log(1.0e-3))
"""Prior of a fault of one kind setting in within the spacing of onset candidates (estimate)."""


def log_hazards() -> Array:
    """Prior of each kind setting in at once (first row) or beginning to grow, shape (2, N_KINDS); -inf: never."""
    shapes = ([k.sudden for k in FAULT_KINDS], [k.growing for k in FAULT_KINDS])
    return LOG_HAZARD + np.array([[-np.inf if h is None else h for h in likelier] for likelier in shapes])


def directions() -> Array:
    """Change of each component per unit of amplitude, shape (N_KINDS, N_COMPONENTS)."""
    table = np.zeros((N_KINDS, N_COMPONENTS))
    for k, kind in enumerate(FAULT_KINDS):
        for name, share in kind.moves:
            table[k, INDEX[name]] = share
    return table


def kind_scales() -> Array:
    """One-sigma size of each kind of fault, shape (N_KINDS,)."""
    return np.array([k.scale for k in FAULT_KINDS])


_WALK: dict[str, float] = {
    "ln_slipper": 0.0005,
    "ln_laminar": 0.0005,
    "throttled": 0.0002,
    "bleed": 0.0004,
    "system_orifice": 0.002,
    "system_laminar": 0.001,
    "setting": 0.01,
    "softening": 0.0005,
    "ln_droop": 0.0005,
    "ln_drain": 0.0005,
    "drain_viscosity": 0.0005,
    "drain_flow": 0.0005,
    "case_warmth": 0.0002,
    "ln_viscosity": 0.001,
    "case_offset": 0.006,
    "reservoir": 0.0005,
    "ln_ripple": 0.001,
    "ln_case_ripple": 0.002,
    "once": 0.002,
    "load_case": 0.001,
    "load_case_square": 0.001,
    "load_warmth": 0.0005,
    "load_discharge": 0.01,
    "load_discharge_square": 0.01,
}
"""One-sigma change of each component from record to record of a healthy pump (estimates, held against the studies of
``benchmarks/results``; the zero's: 0.06 bar over some hundred flights)."""

FREE_SETTING_WALK_BAR = 0.05
"""Change of the setting from record to record where it moves beside another fault (estimate: 3 bar in 60 to 300 records)."""
UNMEASURED_RESERVOIR_WALK_BAR = 0.2
"""Change of the reservoir pressure from flight to flight where no sensor tells (estimate)."""
MEASURED_RESERVOIR_SD_BAR = 0.01
"""What a reservoir sensor leaves unknown of its own pressure (estimate: where one is fitted, its zero is checked with the pump off)."""


def prior(pump: PumpType) -> tuple[Array, Array]:
    """Mean and one-sigma spread of the state of a newly installed healthy pump, shapes (N_STATE,), (N_STATE,)."""
    population = pump.population
    mean, sd = np.zeros(N_STATE), np.zeros(N_STATE)
    # the by-pass flow of table 2-1, and nobody knows through what
    mean[PLACE["system_orifice"]] = mean[PLACE["system_laminar"]] = 0.2
    mean[PLACE["drain_viscosity"]] = mean[PLACE["drain_flow"]] = 0.2
    mean[PLACE["once"]] = 0.03
    spread = {
        "ln_slipper": population["pump_leakage_scale"].value,
        "ln_laminar": population["pump_leakage_scale"].value,
        "throttled": 0.02,
        "bleed": 0.05,
        "system_orifice": population["system_leakage_lpm"].value,
        "system_laminar": population["system_leakage_lpm"].value,
        "setting": population["pressure_setting_bar"].value,
        "softening": 0.3,
        "ln_droop": 0.7 * population["droop_scale"].value,
        "ln_drain": population["drain_resistance_scale"].value,
        "drain_viscosity": population["drain_viscosity_weight"].value,
        "drain_flow": population["drain_flow_weight"].value,
        "case_warmth": 0.01,
        "ln_viscosity": 0.04,
        "case_offset": population["case_zero_bar"].value,
        "reservoir": MEASURED_RESERVOIR_SD_BAR,
        "ln_ripple": 0.2,
        "ln_case_ripple": 0.3,
        "once": 0.03,
        # of 1.2 bar that 20 L/min make in the return line, and of the 2 bar that they cost the regulated pressure
        "load_case": 0.15,
        "load_case_square": 0.15,
        "load_warmth": 0.12,
        "load_discharge": 0.3,
        "load_discharge_square": 0.3,
    }
    for name, value in spread.items():
        sd[PLACE[name]] = value
    return mean, sd


def walk_variance() -> Array:
    """Process noise of a healthy pump from record to record, shape (N_STATE,)."""
    variance = np.zeros(N_STATE)
    for name, sd in _WALK.items():
        variance[PLACE[name]] = sd**2
    return variance
