r"""Before a sensor is bought: the smallest fault of each kind that it would detect, and the smallest that it would isolate.

Baseline flights of a healthy pump are followed by flights with a fault of constant size a, setting in at once. All that
differs between pumps, aircraft and sensors is unknown and wanders (a linear Gaussian state), so that the stacked
measurements are y = a g + e with e of covariance S; g is the fault's signature. The deflection of the best linear test
is d = a sqrt(g' S^-1 g): nuisances are marginalised, not known. A fault is *detectable* where

    d >= z(1 - p_fa) + z(p_d)

(two-sided faults: p_fa / 2), that is where the test that is exceeded by a healthy pump with probability p_fa is exceeded
with probability p_d. It is *isolable* from a rival h when that still holds after the rival, of any size and either
sign, has been projected out: g' S^-1 g is then less (g' S^-1 h)^2 / (h' S^-1 h). The inner products are sums over
flights of innovations of one Kalman filter, so every number of flights comes in one pass.

These are bounds of a linear model whose noise and walks are known: a judge that must learn them, or a pump whose laws
differ from the twin's, does worse.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import ndtri

from detectors.bank.hypotheses import FaultKind, pure_kinds, rows_of
from detectors.isolability.model import LARGEST_LEAKAGE_LPM, Model, model_of
from detectors.isolability.plan import Plan, PlanFaultsError, plan_faults
from detectors.words.verdict import SIDE_OF, Side, State
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

LARGEST_SCALES = 3.0
"""A fault of more than so many times its kind's scale is outside the linear model: what needs more counts as not
detectable, or not isolable."""
_UNITS = {
    "setting": "bar",
    "case_offset": "bar",
    "reservoir": "bar",
    "drain_extra": "%",
}


@dataclass(frozen=True, slots=True)
class Rival:
    """Another cause: size from which the fault is told from it (infinite: never), and how alike their traces are.

    ``cosine`` is that of the angle between both whitened signatures, 1 when nothing but the size differs.
    """

    name: str
    state: State
    smallest_isolable: float
    cosine: float


@dataclass(frozen=True, slots=True)
class FaultBound:
    """Bounds of one kind of fault in ``unit``; infinite where ``largest`` would not do.

    Attributes
    ----------
    smallest_detectable, smallest_isolable
        After the last flight; the second against the worst rival of another state.
    rivals
        Every cause of another state, the worst first.
    ambiguity_group
        Rivals that a fault of up to ``largest`` cannot be told from.
    detectable_by_flights, isolable_by_flights
        After each flight with the fault, shape (flights,).
    """

    name: str
    state: State
    unit: str
    largest: float
    smallest_detectable: float
    smallest_isolable: float
    rivals: tuple[Rival, ...]
    ambiguity_group: tuple[str, ...]
    detectable_by_flights: Array
    isolable_by_flights: Array

    def isolable_from(self, side: Side) -> float:
        """Smallest size that is told from every cause of one side."""
        return max((r.smallest_isolable for r in self.rivals if SIDE_OF[r.state] is side), default=0.0)


@dataclass(frozen=True, slots=True)
class Isolability:
    """Bounds of every kind of fault, what the case sensor should hold, and remarks in words."""

    plan: Plan
    faults: tuple[FaultBound, ...]
    case_pressure_range_bar: tuple[float, float]
    remarks: tuple[str, ...] = ()

    def fault(self, name: str) -> FaultBound:
        """Bounds of one kind."""
        return next(f for f in self.faults if f.name == name)


def isolability(plan: Plan, pump: PumpType, circuit: Circuit) -> Isolability:
    """Smallest detectable and smallest isolable faults of a plan.

    Raises
    ------
    PlanFaultsError
        naming every fault of the plan.
    """
    faults = plan_faults(plan)
    if faults:
        raise PlanFaultsError(faults)
    model = model_of(plan, pump, circuit)
    kinds = [k for k in pure_kinds() if k.moves and (k.component != "reservoir" or plan.sensors.reservoir is not None)]
    products = inner_products(model, rows_of([k.moves for k in kinds]), plan.baseline_flights)
    found = [_bound(plan, i, kinds, products) for i, kind in enumerate(kinds) if kind.state is not State.HEALTHY]
    return Isolability(plan, tuple(found), model.case_pressure_range_bar, _remarks(plan, model))


def _remarks(plan: Plan, model: Model) -> tuple[str, ...]:
    highest, full_scale = model.case_pressure_range_bar[1], plan.sensors.case.full_scale_bar
    remarks = []
    if highest > full_scale:
        remarks.append(
            f"the case of a pump worn by {LARGEST_LEAKAGE_LPM:g} L/min reaches {highest:.2f} bar: "
            f"a sensor of {full_scale:g} bar saturates before"
        )
    if plan.sensors.reservoir is None:
        remarks.append("without a reservoir sensor a change of reservoir pressure looks like leakage")
    return tuple(remarks)


def inner_products(model: Model, moves: Array, n_baseline: int) -> Array:
    """Inner products g' S^-1 h of the signatures after each flight with the fault, shape (flights, k, k).

    Parameters
    ----------
    moves
        What each fault moves per unit of its size, shape (k, N_COMPONENTS).
    n_baseline
        Flights before the fault.
    """
    P = np.diag(model.prior)
    walk = np.diag(model.walk)
    state = np.zeros((len(model.prior), len(moves)))
    total = np.zeros((len(moves), len(moves)))
    found = []
    for i, flight in enumerate(model.flights):
        P = P + walk
        H = flight.slopes
        PH = P @ H.T
        L = np.linalg.cholesky(H @ PH + flight.noise)
        gain = solve_triangular(L, PH.T, lower=True, check_finite=False)
        if i >= n_baseline:
            # the filter's answer to each signature: linear, so that all go along in one pass
            white = solve_triangular(L, H @ (moves.T - state), lower=True, check_finite=False)
            total = total + white.T @ white
            state = state + gain.T @ white
            found.append(total)
        P = P - gain.T @ gain
        P = 0.5 * (P + P.T)
    return np.array(found)


def _bound(plan: Plan, place: int, kinds: list[FaultKind], products: Array) -> FaultBound:
    kind = kinds[place]
    tail = plan.false_alarm_probability / (1.0 if kind.sign else 2.0)
    needed = float(ndtri(1.0 - tail) + ndtri(plan.detection_probability))
    own = products[:, place, place]
    largest = LARGEST_SCALES * kind.scale
    rivals, by_flights = [], np.zeros(len(own))
    for other, rival in enumerate(kinds):
        if rival.state is kind.state:
            continue
        cross, theirs = products[:, place, other], products[:, other, other]
        left = own - np.divide(cross**2, theirs, out=np.zeros_like(own), where=theirs > 0.0)
        sizes = _sizes(needed, left, own, largest)
        by_flights = np.maximum(by_flights, sizes)
        scale = math.sqrt(float(own[-1] * theirs[-1]))
        cosine = abs(float(cross[-1])) / scale if scale > 0.0 else 0.0
        rivals.append(Rival(rival.name, rival.state, _in_unit(kind, float(sizes[-1])), min(cosine, 1.0)))
    rivals.sort(key=lambda r: (-r.smallest_isolable, -r.cosine, r.name))
    detectable = _sizes(needed, own, own, largest)
    return FaultBound(
        name=kind.name,
        state=kind.state,
        unit=_UNITS.get(kind.component, "L/min"),
        largest=_in_unit(kind, largest),
        smallest_detectable=_in_unit(kind, float(detectable[-1])),
        smallest_isolable=_in_unit(kind, float(by_flights[-1])),
        rivals=tuple(rivals),
        ambiguity_group=tuple(r.name for r in rivals if math.isinf(r.smallest_isolable)),
        detectable_by_flights=np.array([_in_unit(kind, float(v)) for v in detectable]),
        isolable_by_flights=np.array([_in_unit(kind, float(v)) for v in by_flights]),
    )


def _sizes(needed: float, left: Array, own: Array, largest: float) -> Array:
    """Size whose deflection is what is needed, infinite beyond the largest, shape of ``left``."""
    # a difference of two equal numbers is rounding, not information
    usable = left > 1.0e-9 * own
    sizes = np.where(usable, needed / np.sqrt(np.where(usable, left, 1.0)), math.inf)
    return np.where(sizes <= largest, sizes, math.inf)


def _in_unit(kind: FaultKind, size: float) -> float:
    return 100.0 * size if kind.component == "drain_extra" else size
