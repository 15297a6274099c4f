"""From the evidence of a bank to words: sequential alarm, the fault it names, or what remains possible."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import lru_cache

import numpy as np

from detectors.bank.bank import Bank
from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.shapes import AS_STATED, N_MOMENTS, N_WAYS, ON_OFF, REMEMBERED, WHOLE, Array, Meaning, Sums
from detectors.bank.summary import summed
from detectors.bank.tables import ARRIVAL_FLOOR_LPM
from detectors.judgement.memory import ON_THIS_RECORD, Showing
from detectors.words.verdict import CAUSES, FAULTS, SIDE_OF, Fit, Intermittent, Side, State

QUANTITIES: Mapping[str, tuple[str, ...]] = {
    "pump_leakage_change_lpm": ("slipper_extra", "laminar_extra"),
    "system_leakage_change_lpm": ("system_orifice",),
    "pressure_setting_change_bar": ("setting",),
    "drain_resistance_change_percent": ("drain_extra",),
}
"""Estimated changes, and the components that they are counted in."""
WORN_PROBABILITY = 0.75
WORN_RECORDS = 4
"""Probability of having arrived worn, and records in a row above it, from which a pump is called so."""
_FITS, _FEWEST = 0.6, 5
"""Share of the last records that health must explain, and records below which nothing is said of it (our choice: good records
miss once in 16,000, foreign laws and outliers a few times in a hundred)."""
_SURE = 0.98
"""Share of one cause under either prior beyond which nobody is told that the data cannot tell."""
_WORTH_A_WORD = 5.0
"""Change of the regulated pressure that is worth a word of a type without a twin, in what its sensor repeats to (our choice)."""
_KEPT = 0.82
"""Share of its level down to which what is named keeps its name."""
_FAULTS_OF: Mapping[Side, tuple[State, ...]] = {
    side: tuple(f for f in FAULTS if SIDE_OF[f] is side) for side in (Side.PUMP, Side.SYSTEM, Side.SENSOR)
}


@dataclass(frozen=True, slots=True)
class Evidence:
    """Where the evidence stands after one record.

    ``log_odds`` is that of any fault against health [nat]; ``probabilities`` sum to 1 over healthy and faults;
    ``weights`` are the filters' shares, shape (m,), ``by_prior`` those by the tempered likelihood under either prior, shape
    (2, m); ``shares`` are those of the faults and of ``other`` among what
    changed since the first record, ``surely`` the least of them under either prior; ``arrival`` is the probability that
    the pump came worn; ``early`` says that the likeliest change set in before the baseline stood; ``together`` holds the
    shares of two faults by the first and the second, shape (n, n) in the order of ``FAULTS``;
    ``moments`` belong to ``QUANTITIES`` (``detectors.bank.shapes.Sums``).
    """

    log_odds: float
    probabilities: Mapping[State, float]
    weights: Array
    by_prior: Array
    shares: Mapping[State, float]
    surely: Mapping[State, float]
    arrival: float
    early: bool
    together: Array
    moments: Array


@dataclass(frozen=True, slots=True)
class Alarm:
    """Memory of the sequential decision between records.

    An alarm is raised after ``above`` records in a row over the on-level and ends below the off-level. ``state`` and
    ``side`` lead among the faults for ``state_for`` and ``side_for`` records in a row with a share over their level;
    what is named keeps its name until its share falls clearly below that.
    """

    raised: bool = False
    above: int = 0
    state: State | None = None
    state_for: int = 0
    side: Side | None = None
    side_for: int = 0
    worn_for: int = 0

    def moved(self, records: int) -> "Alarm":
        """In another aircraft: who was not called worn before is not within the next ``records``, its drain is unknown."""
        return self if self.worn_for >= WORN_RECORDS else replace(self, worn_for=-records)


@dataclass(frozen=True, slots=True)
class Decision:
    """State with what remains possible; ``candidates`` is empty unless the state is ``indeterminate``."""

    state: State
    candidates: tuple[State, ...] = field(default=())


def evidence(bank: Bank, thresholds: Mapping[str, float]) -> Evidence:
    """Sum the bank's filters by the state they stand for, and by the quantity they change."""
    smallest = None
    if not bank.pump.own_twin:
        smallest = _WORTH_A_WORD * bank.pump.sensors["discharge_pressure_bar"].repeatability_bar
    meaning = _meaning(thresholds["sensor_shift_bar"], smallest)
    # what regulation shows is independent of the means: it stands against the pump that is healthy by them
    odds = math.exp(min(bank.regulation.log_odds(), _MOST_LOG_ODDS))
    sums = Sums(
        weights=np.empty((N_WAYS, bank.n)),
        of_all=np.empty((N_WAYS, len(_CHANGES) + 1)),
        changed=np.empty((N_WAYS, len(_CHANGES) + 1)),
        together=np.empty((len(FAULTS), len(FAULTS))),
        moments=np.empty((len(QUANTITIES), N_MOMENTS)),
    )
    arrival = summed(bank.filters, bank.n, bank.records, meaning, sums)
    whole, stated, neutral = by_cause = sums.of_all.tolist()
    changed, by_stated, by_neutral = by_change = sums.changed.tolist()
    for row in (*by_cause, *by_change):
        row[_COMPENSATOR] += row[-1] * odds
    shares, alike = _shares(by_stated[:-1]), _shares(by_neutral[:-1])
    weights = sums.weights[WHOLE]
    return Evidence(
        # how a pump came is a question of its own: an alarm is raised by what changed since
        log_odds=math.log(max(sum(changed[:-1]), 1.0e-300)) - math.log(max(changed[-1], 1.0e-300)),
        probabilities=_probabilities(whole, stated, neutral),
        weights=weights,
        by_prior=sums.weights[AS_STATED:],
        shares=dict(zip(_CHANGES, (0.5 * (a + b) for a, b in zip(shares, alike, strict=True)), strict=True)),
        surely=dict(zip(_CHANGES, map(min, shares, alike), strict=True)),
        arrival=arrival,
        # what the pump before has handed on set in before the first record, against that pump's reference
        early=bool(0 <= bank.filters.onset[int(weights.argmax())] < thresholds["baseline_records"]),
        together=sums.together,
        moments=sums.moments,
    )


@lru_cache(maxsize=64)
def _meaning(sensor_shift_bar: float, setting_bar: float | None) -> Meaning:
    """What filters count for where sensors must move by so much to be worth a word, and the setting (None: as usual)."""
    floors = _MEANING.floors.copy()
    floors[_IS_SENSOR] = sensor_shift_bar
    if setting_bar is None:
        return _MEANING._replace(floors=floors)
    floors[FAULT_KINDS.index(_MOVED)] = setting_bar
    return _MEANING._replace(floors=floors, setting_floor=setting_bar)


def _probabilities(whole: Sequence[float], stated: Sequence[float], neutral: Sequence[float]) -> dict[State, float]:
    """Of all causes: whether anything changed by the whole evidence, which cause by the tempered one under both priors."""
    healthy = _shares(whole)[-1]
    shares = [0.5 * (a + b) for a, b in zip(_shares(stated[:-1]), _shares(neutral[:-1]), strict=True)]
    return dict(zip(CAUSES, [healthy, *((1.0 - healthy) * s for s in shares)], strict=True))


def decided(alarm: Alarm, found: Evidence, thresholds: Mapping[str, float]) -> tuple[Alarm, Decision]:
    """One step of the sequential decision: is there an alarm, whose side is it, and which fault of that side.

    What is named must lead under the stated and under the shape-neutral prior: where they disagree, the prior would decide.
    """
    worn_for = alarm.worn_for + 1
    if found.arrival <= WORN_PROBABILITY:
        worn_for = min(worn_for, 0)
    above = alarm.above + 1 if found.log_odds > thresholds["alarm_on_log_odds"] else 0
    raised = above >= thresholds["alarm_records"] or (
        alarm.raised and found.log_odds >= thresholds["alarm_off_log_odds"]
    )
    share, surely = found.shares, found.surely
    leader = max(_CHANGES, key=lambda f: share[f])
    by_side = {s: sum(surely[f] for f in faults) for s, faults in _FAULTS_OF.items()}
    side = max(by_side, key=lambda s: by_side[s])
    level = _level(thresholds["system_side_probability" if side is Side.SYSTEM else "side_probability"], found)
    records = thresholds["side_records"]
    of_state = _level(thresholds["state_probability"], found)
    state_for = _led_for(surely[leader], of_state, alarm.state_for if alarm.state is leader else 0, records)
    side_for = _led_for(by_side[side], level, alarm.side_for if alarm.side is side else 0, records)
    following = Alarm(
        raised, above, leader if state_for else None, state_for, side if side_for else None, side_for, worn_for
    )
    if worn_for >= WORN_RECORDS and (not raised or leader is State.PUMP_DEGRADATION):
        return following, Decision(State.PUMP_DEGRADATION)
    if not raised:
        return following, Decision(State.HEALTHY)
    if (state_for >= records or surely[leader] > _SURE) and leader is not State.OTHER:
        return following, Decision(leader)
    # a side with a single fault leaves nothing to be undecided about, so it waits for its state
    rivals = _FAULTS_OF[side] if side_for >= records and len(_FAULTS_OF[side]) > 1 else _CHANGES
    # what is not named yet has a rival: a single candidate would be an accusation
    likely = set(sorted(rivals, key=lambda f: share[f])[-2:])
    candidates = tuple(f for f in rivals if f in likely or share[f] >= thresholds["candidate_probability"])
    return following, Decision(State.INDETERMINATE, candidates)


def _level(share: float, found: Evidence) -> float:
    """Share that a name needs: surer where the change set in before the pump's own reference stood."""
    return max(share, _SURE) if found.early else share


def _led_for(share: float, level: float, before: int, records: float) -> int:
    """Records in a row that something has led for, with this one; 0 where its share is too small."""
    named = before >= records
    return before + 1 if share > (_KEPT * level if named else level) else 0


def secondary(found: Evidence, state: State) -> State | None:
    """The fault that more likely than not came beside the named one; None for none."""
    if state not in FAULTS:
        return None
    row = found.together[FAULTS.index(state)]
    place = int(row.argmax())
    return FAULTS[place] if row[place] > 0.5 * found.probabilities[state] else None


def fitting(decision: Decision, fit: Fit, found: Evidence) -> Decision:
    """A pump is healthy when its records fit: what most of the last records contradict is not, whatever else leads.

    A fault that is as good as sure, and only waits for its alarm, is not undecided: what leads then is its own filter.
    """
    if decision.state is not State.HEALTHY or fit.records < _FEWEST or fit.explained >= _FITS * fit.records:
        return decision
    rival = max(FAULTS, key=lambda f: found.shares[f])
    if found.probabilities.get(rival, 0.0) > _SURE:
        return decision
    return Decision(State.INDETERMINATE, (rival, State.OTHER))


def without_fit(fit: Fit, found: Evidence) -> Evidence:
    """The evidence where health does not fit: it keeps the share of the records that it explains, no known cause the rest."""
    lost = found.probabilities[State.HEALTHY] * (1.0 - fit.explained / fit.records)
    probabilities = dict(found.probabilities)
    probabilities[State.HEALTHY] -= lost
    probabilities[State.OTHER] += lost
    return replace(found, probabilities=probabilities)


def cautious(found: Evidence) -> Evidence:
    """The evidence as it is said where nothing is named: a leader has the lesser of its shares under the two priors."""
    leader = max(_CHANGES, key=lambda s: found.shares[s])
    if found.probabilities[leader] <= _SURE or leader is State.OTHER:
        return found
    rest = {s: found.probabilities[s] for s in _CHANGES if s is not leader}
    given = (found.shares[leader] - found.surely[leader]) * (1.0 - found.probabilities[State.HEALTHY])
    whole = sum(rest.values())
    spread = {s: p + given * (p / whole if whole > 0.0 else 1.0 / len(rest)) for s, p in rest.items()}
    probabilities = {**found.probabilities, **spread, leader: found.probabilities[leader] - given}
    return replace(found, probabilities=probabilities)


def explained_by(bank: Bank, found: Evidence) -> tuple[int, int, bool]:
    """How many records the likeliest filter was asked and how many it explains, and whether it explains the last one."""
    leading = int(found.weights.argmax())
    asked = min(bank.records, REMEMBERED)
    unexplained = int(bank.filters.unexplained[leading]) & (2**asked - 1)
    return asked, asked - unexplained.bit_count(), not unexplained & 1


def suspect(decision: Decision, found: Evidence) -> State | None:
    """The fault that leads where something is wrong; None where nothing is."""
    if decision.state is State.HEALTHY:
        return None
    return max(FAULTS, key=lambda f: found.shares[f])


def coming_and_going(bank: Bank, found: Evidence, state: State, since: datetime | None) -> Intermittent | None:
    """On how many of the last records the leading fault showed, where it is one that comes and goes.

    ``since`` is when the alarm began; without one nothing comes and goes.
    """
    leading = int(found.weights.argmax())
    filters = bank.filters
    if since is None or filters.shape[leading] != ON_OFF or state is State.HEALTHY:
        return None
    asked = min(bank.records - int(filters.onset[leading]), REMEMBERED)
    shown = (int(filters.shown[leading]) & (2**asked - 1)).bit_count()
    return Intermittent(FAULT_KINDS[filters.kind[leading]].state, shown, asked, since)


def showing(bank: Bank, found: Evidence, state: State) -> Showing:
    """On which of the last records the fault that leads the alarm shows: on all of them unless it comes and goes."""
    filters, kinds = bank.filters, bank.filters.kind[: bank.n]
    rows = [f for f, k in enumerate(kinds.tolist()) if k >= 0 and FAULT_KINDS[k].state is state]
    if not rows:
        return ON_THIS_RECORD
    leading = max(rows, key=lambda f: found.weights[f])
    if filters.shape[leading] != ON_OFF:
        return ON_THIS_RECORD
    asked = min(bank.records - int(filters.onset[leading]), REMEMBERED)
    shown = int(filters.shown[leading]) & (2**asked - 1)
    # bits before this record, from the first one on which it showed
    return Showing(bool(shown & 1), (shown >> 1).bit_count(), max(shown.bit_length() - 1, 0))


def leading_sensor(bank: Bank, found: Evidence) -> str | None:
    """Channel of the sensor fault with the greatest share, or the only pressure that the type has; None without one."""
    fitted = [c for c in ("case_pressure_bar", "discharge_pressure_bar") if c not in bank.pump.lacks]
    if len(fitted) == 1:
        return fitted[0]
    share: dict[str, float] = {}
    for kind, weight in zip(bank.filters.kind[: bank.n], found.weights, strict=True):
        sensor = FAULT_KINDS[kind].sensor if kind >= 0 else None
        if sensor is not None:
            share[sensor] = share.get(sensor, 0.0) + float(weight)
    return max(share, key=lambda s: share[s]) if share else None


def _quantity(component: str) -> int:
    """Number of the quantity that a component counts for; -1 for none."""
    return next((i for i, names in enumerate(QUANTITIES.values()) if component in names), -1)


def _shares(sums: Sequence[float]) -> list[float]:
    """Sums of evidence as shares that add up to 1; all alike where there is none."""
    whole = sum(sums)
    return [s / whole for s in sums] if whole > 0.0 else [1.0 / len(sums)] * len(sums)


_CHANGES: tuple[State, ...] = (*FAULTS, State.OTHER)
"""What can have changed, in the order of the sums."""
_COMPENSATOR = FAULTS.index(State.COMPENSATOR_FAULT)
_MOST_LOG_ODDS = 600.0
"""Beyond 709 a double overflows."""
_MOVED = next(k for k in FAULT_KINDS if k.component == "setting")
_IS_SENSOR = np.array([k.sensor is not None for k in FAULT_KINDS] + [False, False])
"""By entry of ``Meaning.floors``."""
_MEANING = Meaning(
    signs=np.array([k.sign for k in FAULT_KINDS] + [0]),
    most=np.array([k.most for k in FAULT_KINDS] + [np.inf]),
    floors=np.array([k.floor for k in FAULT_KINDS] + [0.0, ARRIVAL_FLOOR_LPM]),
    states=np.array(
        [_CHANGES.index(k.state) if k.state in _CHANGES else len(_CHANGES) for k in FAULT_KINDS] + [len(_CHANGES)]
    ),
    quantities=np.array([_quantity(k.component) for k in FAULT_KINDS] + [-1]),
    beside=np.array([-1 if k.beside is None else FAULTS.index(k.beside) for k in FAULT_KINDS] + [-1]),
    scales=np.array([k.scale for k in FAULT_KINDS] + [1.0]),
    setting_scale=_MOVED.scale,
    setting_floor=_MOVED.floor,
    setting_quantity=_quantity(_MOVED.component),
)
