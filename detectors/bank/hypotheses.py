"""What every hypothesis carries: the state, how it wanders in a healthy pump, and the faults that may move it.

A state vector holds what differs between pumps, aircraft and sensors (the nuisances, all alive, none frozen; see
``detectors.expectation.components``), one fault amplitude and that amplitude's change from record to record. The fault stands
inside the flows, not beside them: a big fault is not a small one times a slope.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from detectors.bank.shapes import ALIKE, ARRIVAL, N_SHAPES, ON_OFF, OPEN, RAMP, STATED, STEP
from detectors.expectation.components import INDEX, N_COMPONENTS, N_STATE, PLACE
from detectors.words.verdict import FAULTS, State
from twin.parameters import PumpType

Array = NDArray[np.float64]

ONCE_PER_LEAKAGE = 1.1
"""Line at once per revolution in discharge pressure that unequal leakage draws [bar per L/min]: one slipper gap x 1.8
gives 260 mbar with 0.22 L/min, three pistons +150 % give 57 mbar with 0.056 L/min (own transient runs)."""


@dataclass(frozen=True, slots=True)
class Law:
    """How a fault's law may lie between others: ``moves`` times its place, in units of the amplitude, come on top.

    ``mean`` and ``sd`` of the place are its prior; ``pure`` names the laws that are one thing alone, with their places.
    """

    moves: tuple[tuple[str, float], ...] = ()
    mean: float = 0.0
    sd: float = 0.0
    pure: tuple[tuple[str, float], ...] = ()


NO_LAW = Law()


@dataclass(frozen=True, slots=True)
class FaultKind:
    """One way in which something can change, mostly for the worse: which components move with its amplitude, how far, in
    which direction.

    ``scale`` is the one-sigma size of a fault in the first component's unit; ``floor`` the size below which it is
    not worth a word and counts as healthy; ``sign`` is +1 when the amplitude can only be positive (a leak does not heal),
    0 when both directions occur. ``law`` is how its dependence on the condition may differ. ``sensor`` names the channel of
    a sensor fault. ``share`` is its part of its state's prior: kinds of one state share it, so that a state with many kinds
    is no likelier than one with few. ``sudden``, ``growing`` and ``comes_and_goes`` say in which shapes it occurs.
    ``beside`` names a second fault that comes with it: from the onset on the setting goes where it likes. ``most`` is the largest
    size that it can have.
    """

    name: str
    state: State
    moves: tuple[tuple[str, float], ...]
    scale: float
    floor: float
    sign: int
    sensor: str | None = None
    law: Law = NO_LAW
    share: float = 1.0
    sudden: bool = True
    growing: bool = True
    comes_and_goes: bool = False
    beside: State | None = None
    most: float = math.inf

    @property
    def component(self) -> str:
        """The component that the amplitude is counted in; empty where there is none."""
        return self.moves[0][0] if self.moves else ""


_TWO = math.exp(-4.0)
"""Share of two faults that set in together (estimate)."""
_PUMP, _DRAIN, _SENSOR = State.PUMP_DEGRADATION, State.DRAIN_RESTRICTION, State.SENSOR_FAULT
_SLIPPERS, _LEAK = (("slipper_extra", 1.0),), 0.4
_CASE = "case_pressure_bar"
_RESISTANCE, _MORE = (("drain_extra", 1.0),), 0.45
_THROTTLED = Law(
    (("slipper_extra", -1.0), ("throttled", 1.0)),
    0.1,
    0.25,
    (("leakage, slippers", 0.0), ("leakage, mixed", 0.5), ("leakage, throttled", 1.0)),
)
"""A wide slipper gap leaves the throttle in charge (estimate: a tenth of what is added, give or take a quarter)."""
_THINNER = (("ln_viscosity", 1.0), ("setting", 0.9))
"""A thinner product also regulates lower, by 0.9 bar per unit of the logarithm (operating point, four products)."""
_GAP_OR_ORIFICE = Law(
    (("system_orifice", -1.0), ("system_laminar", 1.0)),
    0.5,
    0.4,
    (("system leakage, orifice", 0.0), ("system leakage, laminar", 1.0)),
)
"""Nobody knows through what a circuit leaks."""
_CLOGGED = Law((("drain_viscous", 1.0), ("drain_orifice", -1.0)), 0.0, 0.15, (("drain restriction", 0.0),))
"""What clogs a drain has its line's law, more of a filter's (viscous), or more of a narrowed fitting's (estimate)."""
_CONTROL_FLOW_LPM = 0.6
"""What bleeds passes the control valve, and this is its whole flow (operating point)."""
FAULT_KINDS: tuple[FaultKind, ...] = (
    FaultKind(
        "leakage, slippers",
        _PUMP,
        _SLIPPERS,
        _LEAK,
        0.05,
        1,
        law=_THROTTLED,
        share=0.5,
        comes_and_goes=True,
    ),
    FaultKind(
        "leakage, port plate",
        _PUMP,
        (("laminar_extra", 1.0),),
        _LEAK,
        0.05,
        1,
        law=Law((("laminar_extra", -1.0), ("throttled", 1.0)), 0.0, 0.1, (("leakage, port plate", 0.0),)),
        share=0.3,
    ),
    FaultKind("uneven wear", _PUMP, (*_SLIPPERS, ("once", ONCE_PER_LEAKAGE)), 0.2, 0.02, 1, share=0.2),
    FaultKind("setting", State.COMPENSATOR_FAULT, (("setting", 1.0),), 2.0, 0.7, 0, share=0.8),
    FaultKind("bleed", State.COMPENSATOR_FAULT, (("bleed", 1.0),), 0.2, 0.05, 1, share=0.2, most=_CONTROL_FLOW_LPM),
    FaultKind(
        "system leakage",
        State.SYSTEM_LEAKAGE,
        (("system_orifice", 1.0),),
        3.0,
        0.3,
        1,
        law=_GAP_OR_ORIFICE,
        comes_and_goes=True,
    ),
    FaultKind("drain restriction", _DRAIN, _RESISTANCE, _MORE, 0.06, 1, law=_CLOGGED, comes_and_goes=True),
    FaultKind("case sensor", _SENSOR, (("case_offset", 1.0),), 0.15, 0.06, 0, _CASE, share=0.4),
    FaultKind("case sensor, span", _SENSOR, (("case_span", -1.0),), 0.3, 0.1, 1, _CASE, share=0.2, growing=False),
    FaultKind("fluid batch", State.HEALTHY, _THINNER, 0.06, 0.0, 0, growing=False),
    FaultKind(
        "drain restriction, setting moves",
        _DRAIN,
        _RESISTANCE,
        _MORE,
        0.06,
        1,
        law=_CLOGGED,
        share=_TWO,
        sudden=False,
        beside=State.COMPENSATOR_FAULT,
    ),
    FaultKind(
        "leakage, setting moves",
        _PUMP,
        _SLIPPERS,
        _LEAK,
        0.05,
        1,
        law=_THROTTLED,
        share=_TWO,
        sudden=False,
        beside=State.COMPENSATOR_FAULT,
    ),
    FaultKind("reservoir sensor", _SENSOR, (("reservoir", 1.0),), 0.5, 0.1, 0, "reservoir_pressure_bar", share=0.4),
    FaultKind("none of these", State.OTHER, (), 0.0, 0.0, 0, growing=False),
    FaultKind("fault gone", State.HEALTHY, (), 0.0, 0.0, 0, growing=False),
)
"""Sizes are estimates: what is worth finding on an H225 and what the literature's rigs show; so are the shares within a
state: nobody counts which gap of a pump wears first.

One sigma of a leak, of the circuit's leak and of a clogged drain moves the case pressure alike: 0.14, 0.16 and 0.17 bar at
60 degC (0.34 and 0.053 bar per L/min, 0.39 bar per unit). A fault's size wanders by a share of it from record to record: whoever
may wander less in what the sensor sees follows a slow change with less noise, and gains on the others with every record.
"""
N_KINDS = len(FAULT_KINDS)
GONE, OTHER = N_KINDS - 1, N_KINDS - 2
"""The kind that undoes the likeliest fault: it begins where that fault's filter stands, without the fault; and the one
that knows nothing but how far apart two records of a pump may lie."""
HAZARD = 4.0e-3
"""Prior of each state setting in within the spacing of onset candidates, the same for every state (estimate)."""
USUAL_ONSETS = 1.0
"""The same as onsets of a state in 1000 records (``PumpType.population``): candidates lie four records apart."""
_OTHER_HAZARD = 1.0e-3
_FLUID_HAZARD = 5.0e-3
"""A batch is changed once in some hundred flights (estimate)."""
_GONE_HAZARD = 4.0e-4
"""That a fault is gone must stay less likely than the alarm level is high: every new candidate would hold the alarm back."""
_ALIKE = {STEP: 0.45, RAMP: 0.45, ON_OFF: 0.1}
"""Shares of the shapes where nothing is known of a cause (our choice: steps and growth alike, one in ten comes and goes)."""
_WEARS = {STEP: 0.15, RAMP: 0.75, ON_OFF: 0.1}
"""Shares of the shapes of wear: gaps open by abrasion, flight after flight (estimate: one leak in six sets in at once)."""


def hazards_of(pump: PumpType) -> dict[State, float]:
    """Prior of each state setting in within the spacing of onset candidates, as the pump type's population has it."""
    rates = {state: pump.population.get(f"{state.value}_onsets") for state in FAULTS}
    usual = HAZARD / USUAL_ONSETS
    return {state: HAZARD if rate is None else usual * rate.value for state, rate in rates.items()}


def log_priors(log_arrival: float, hazards: Mapping[State, float] | None = None) -> Array:
    """Priors of each kind by shape [nat], shape (2, N_SHAPES, N_KINDS): as stated, and with the same shapes for every cause.

    -inf stands for what never occurs; ``log_arrival`` is that of a pump that comes worn, the same for all kinds. ``hazards``
    are those of the states; None for the same of every state.
    """
    table = np.full((2, N_SHAPES, N_KINDS), -np.inf)
    table[:, ARRIVAL] = log_arrival
    for k, kind in enumerate(FAULT_KINDS):
        if k == OTHER:
            table[:, OPEN, k] = math.log(_OTHER_HAZARD)
            continue
        hazard = (HAZARD if hazards is None else hazards.get(kind.state, HAZARD)) * kind.share
        if kind.state is State.HEALTHY:
            hazard = _GONE_HAZARD if k == GONE else _FLUID_HAZARD
        occurs = {STEP: kind.sudden, RAMP: kind.growing, ON_OFF: kind.comes_and_goes}
        for which, shares in ((STATED, _WEARS if kind.state is _PUMP else _ALIKE), (ALIKE, _ALIKE)):
            for shape, share in shares.items():
                if occurs[shape]:
                    table[which, shape, k] = math.log(hazard * (share if kind.growing else 1.0))
    return table


def directions() -> Array:
    """Change of each component per unit of amplitude, and per unit of its product with the law, (N_KINDS, 2, N_COMPONENTS)."""
    moves = [moves for kind in FAULT_KINDS for moves in (kind.moves, kind.law.moves)]
    return rows_of(moves).reshape(N_KINDS, 2, N_COMPONENTS)


def rows_of(moves: Sequence[tuple[tuple[str, float], ...]]) -> Array:
    """Shares by component, shape (len(moves), N_COMPONENTS)."""
    table = np.zeros((len(moves), N_COMPONENTS))
    for row, shares in zip(table, moves, strict=True):
        for name, share in shares:
            row[INDEX[name]] = share
    return table


def laws() -> Array:
    """Mean and spread of the place of each kind's law, zeros for the healthy pump last, shape (N_KINDS + 1, 2)."""
    return np.array([(kind.law.mean, kind.law.sd) for kind in FAULT_KINDS] + [(0.0, 0.0)])


def pure_kinds() -> tuple[FaultKind, ...]:
    """Kinds of fault with one law each: what can be told from what is asked of these."""
    found: list[FaultKind] = []
    for kind in FAULT_KINDS:
        for name, at in kind.law.pure if kind.beside is None and kind.law.pure else ((kind.name, 0.0),):
            moves = dict(kind.moves)
            for component, share in kind.law.moves:
                moves[component] = moves.get(component, 0.0) + at * share
            kept = tuple((component, share) for component, share in moves.items() if share != 0.0)
            found.append(replace(kind, name=name, moves=kept, law=NO_LAW))
    return tuple(found)


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
    "once": 0.0005,
    "case_ripple_warmth": 0.0005,
    "answer": 0.0005,
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
    # droop lifts the case's line of a cold pump whichever way it differs (surfaces over the droops of the population)
    mean[PLACE["case_ripple_warmth"]] = -0.02
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
        # five times what droops make in simulated pumps: no real pump's lines were held against the surfaces (estimate)
        "case_ripple_warmth": 0.1,
        "answer": 0.2,
        # of 1.2 bar that 20 L/min make in the return line, and of the 2 bar that they cost the regulated pressure
        "load_case": 0.15,
        "load_case_square": 0.15,
        "load_warmth": 0.12,
        "load_discharge": 0.3,
        "load_discharge_square": 0.3,
    }
    if not pump.own_twin:
        # the curve was measured over temperature: what one pump of the type has of its own is what its sensor repeats to
        spread["softening"] = 2.0 * pump.sensors["discharge_pressure_bar"].repeatability_bar
    for name, value in spread.items():
        sd[PLACE[name]] = value
    return mean, sd


def walk_variance() -> Array:
    """Process noise of a healthy pump from record to record, shape (N_STATE,)."""
    variance = np.zeros(N_STATE)
    for name, sd in _WALK.items():
        variance[PLACE[name]] = sd**2
    return variance
