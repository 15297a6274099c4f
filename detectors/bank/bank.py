"""A bank of extended Kalman filters, one per hypothesis, shape and onset, all with the twin inside.

Each filter keeps its own state, its own robust weights and its own evidence: weights taken from a common healthy
filter would kill the very evidence that a fault brings. Predictive densities are Student-t (5 degrees of
freedom), so that one outlier costs a hypothesis a bounded amount.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from detectors.bank.endings import end_fault, take_over
from detectors.bank.hypotheses import (
    FAULT_KINDS,
    GONE,
    MEASURED_RESERVOIR_SD_BAR,
    N_KINDS,
    UNMEASURED_RESERVOIR_WALK_BAR,
    prior,
)
from detectors.bank.kernel import close, free, pass_time, step, surprise
from detectors.bank.lines import LineScatter
from detectors.bank.prediction import CASE, LINE, ZERO, Expected, discrepancy, expected_by_both
from detectors.bank.refit import fit_anew
from detectors.bank.regulation import Regulation
from detectors.bank.shapes import (
    ARRIVAL,
    ON_OFF,
    OPEN,
    STATED,
    STEP,
    Base,
    Filters,
    Freed,
    Integers,
    Kinds,
)
from detectors.bank.summary import beyond_doubt, spawned
from detectors.bank.tables import (
    ARRIVAL_KINDS,
    ARRIVAL_LEAKAGE_LPM,
    BREADTH,
    DIRECTIONS,
    DISCREPANCY,
    IS_HEALTHY,
    KINDS,
    LOG_ARRIVAL,
    MOST_ONSETS,
    WALKS,
    empty_filters,
    kinds_of,
    most_onsets,
    scales_of,
    touched_by,
)
from detectors.bank.window import Measurement, history_of, nothing_freed
from detectors.expectation.anchor import COLUMN
from detectors.expectation.components import AMPLITUDE, LAW, N_LINES, N_SLOW, N_STATE, PLACE
from twin.parameters import PumpType

HEALTHY = -1
SPAWN_EVERY = 4
FIRST_ONSETS = (1, 2)
"""Records after which an onset is tried, beside every fourth one: what sets in at once is as likely at the beginning."""
_FIRST_RECORDS = 5
_ITERATIONS = 4
"""How often the twin is linearised anew in the first records and where one surprises: a resistance that trebles is no small
one times a slope, a leak is, and whoever is taken at the slope's word loses."""
_FITTED_ANEW_AT = (8, 12, 16, 24, 32, 64)
"""Records after which every filter is fitted to its whole history anew (``detectors.bank.refit``)."""
_LONG, _HOPELESS = 24, -1.0
"""Records from which on only those are fitted anew that the data make no less likely than this [nat] against the healthy
pump: more than half of all filters lie below."""
_MOST_PASSES = 6
_BEYOND_DOUBT, _BEYOND_DOUBT_RECORDS = 5.0, 8
"""Lead [nat] over all rivals, and records since it set in, from which a healthy change is taken for granted (estimate: as much
as an alarm asks for)."""
_CURED_NOTHING = -2.0
"""Price of what was done having cured nothing (estimate: one entry in eight does not help) [nat]."""
_LEVEL_EVIDENCE = 1.0
"""Lead that is as good as none [nat] (estimate)."""
_NOTHING = DIRECTIONS[HEALTHY]
_WARMTH, _LOAD = COLUMN["warmth"], COLUMN["load_flow"]
_LEAST_LOAD_LPM = 1.0
"""Flow from which a window counts as one under load (estimate: twice what counts as zero)."""


@dataclass(slots=True)
class Bank:
    """Filters side by side; the first is the healthy hypothesis. Changed in place by its methods.

    Attributes
    ----------
    filters
        Of these the first ``n`` count.
    alive
        How much of the state is alive: N_SLOW as long as the history held no line, N_LINES no window under load, all.
    learnt
        Measurements of each record since the base.
    base
        Where the history begins that filters are fitted anew to.
    freed
        What was made unknown since then.
    refits
        False where the history begins at a state that was learnt: its covariance holds for the point that it was
        linearised about, and a fit about another one would lose what it says.
    kinds
        What faults are, as often as this pump type's population has them.
    ended, resolving
        Kind of the fault that ended with what was done last, and of the one that may have (-1: none).
    """

    pump: PumpType
    filters: Filters = field(default_factory=empty_filters)
    alive: int = N_SLOW
    lines_seen: bool = False
    n: int = 1
    records: int = 0
    reservoir_measured: bool = True
    learnt: list[tuple[Measurement, ...]] = field(default_factory=list)
    base: Base = field(init=False)
    reservoir_seen: bool = False
    freed: Freed = field(default_factory=nothing_freed)
    refits: bool = True
    kinds: Kinds = KINDS
    ended: int = HEALTHY
    resolving: int = HEALTHY
    line_scatter: LineScatter = field(default_factory=LineScatter)
    regulation: Regulation = field(default_factory=Regulation)

    def __post_init__(self) -> None:
        """Start with the population's spread: the healthy pump, and those that arrive worn."""
        self.kinds = kinds_of(self.pump)
        names = [k.name for k in FAULT_KINDS]
        self.n = 1 + len(ARRIVAL_KINDS)
        for row in range(self.n):
            if row > 0:
                self.filters.kind[row], self.filters.shape[row] = names.index(ARRIVAL_KINDS[row - 1]), ARRIVAL
            self._begin(row)
        self.rebase()

    def _begin(self, row: int) -> None:
        """Set a filter that is alive from the first record to its prior."""
        mean, sd = prior(self.pump)
        filters = self.filters
        filters.mean[row], filters.covariance[row] = mean, np.diag(sd**2)
        filters.log_evidence[row] = 0.0
        if filters.shape[row] == ARRIVAL:
            filters.mean[row, AMPLITUDE], spread = ARRIVAL_LEAKAGE_LPM
            filters.covariance[row, AMPLITUDE, AMPLITUDE] = spread**2
            filters.mean[row, LAW], spread = KINDS.laws[filters.kind[row]]
            filters.covariance[row, LAW, LAW] = spread**2
            filters.log_evidence[row] = LOG_ARRIVAL
            filters.prior[row] = LOG_ARRIVAL

    def learn(self, measurements: tuple[Measurement, ...]) -> None:
        """Take one record's windows: let time pass, weigh and update every filter."""
        filters = self.filters
        self._pass_time()
        measurements = tuple(self._as_weighed(m) for m in measurements)
        surprising = self.records >= _FIRST_RECORDS and self._is_surprising(measurements)
        if surprising:
            # a candidate that is late by one record would have to explain it away: whoever does that best is not right
            self.spawn(BREADTH)
        for measurement in measurements:
            if measurement.reservoir_measured is not self.reservoir_measured:
                self._set_reservoir(measurement.reservoir_measured)
            self.reservoir_seen = self.reservoir_seen or measurement.reservoir_measured
            iterations = _ITERATIONS if surprising or self.records < _FIRST_RECORDS else 1
            self._take(measurement, iterations)
            self.regulation.learn(measurement.regulation, measurement.anchor[_WARMTH])
        close(filters, self.n)
        self.records += 1
        self.learnt.append(measurements)
        self._accept()
        if self.refits and self.records - self.base.records in _FITTED_ANEW_AT:
            if self.records - self.base.records >= _LONG:
                self._keep(self._worth_a_fit())
            self._fit_anew()
        # half a bar of unknown reservoir pressure is as much as a worn pump makes
        if not self.reservoir_seen:
            self._keep(np.flatnonzero(filters.shape[: self.n] != ARRIVAL))

    def expected(self, measurement: Measurement) -> tuple[Expected, Expected]:
        """What the healthy and what the likeliest filter expect to be measured."""
        return expected_by_both(self.filters, self.n, DIRECTIONS, measurement.reading)

    def _as_weighed(self, measurement: Measurement) -> Measurement:
        """The measurement with what its noise leaves out.

        Far from where the healthy pump was learnt sensor and laws are less sure of the case pressure; the line at once per
        turn scatters as this pump's own does, which it teaches in turn.
        """
        noise = measurement.noise.copy()
        noise[CASE, CASE] += discrepancy(self.filters.mean[0], _NOTHING, measurement.reading, DISCREPANCY)
        if measurement.seen[-1] == LINE:
            before = self.line_scatter
            self.line_scatter = before.with_line(float(measurement.values[LINE]), float(noise[LINE, LINE]))
            noise[LINE, LINE] += before.variance
        return measurement.with_noise(noise)

    def _is_surprising(self, measurements: tuple[Measurement, ...]) -> bool:
        """Whether the likeliest filter does not explain the record that comes next."""
        return any(surprise(self.filters, self.n, DIRECTIONS, m.reading, self.alive) > 1.0 for m in measurements)

    def _accept(self) -> None:
        """Let the healthy pump go on from where a healthy change took it, once that is beyond doubt."""
        n, filters = self.n, self.filters
        if filters.log_evidence[0] > -_BEYOND_DOUBT:
            return  # nothing lies that far above the healthy pump
        latest = self.records - _BEYOND_DOUBT_RECORDS
        likeliest = beyond_doubt(filters, n, latest, IS_HEALTHY, GONE, _BEYOND_DOUBT)
        if likeliest < 0:
            return
        gone, changed = filters.kind[likeliest] == GONE, IS_HEALTHY[filters.kind[:n]] & (filters.onset[:n] <= latest)
        if gone and self.resolving != HEALTHY:
            self.ended, self.resolving = self.resolving, HEALTHY
        take_over(filters, likeliest, FAULT_KINDS[filters.kind[likeliest]].moves)
        # a fault that is gone leaves nothing of what was thought of it; a new fluid says nothing of other faults
        self._keep(np.zeros(1, dtype=np.int64) if gone else np.flatnonzero(~changed))
        self.rebase()

    def supplement(self, measurement: Measurement) -> None:
        """Take a burst of the flight that was learnt last: nothing but its lines is new, no time passes."""
        measurement = self._as_weighed(measurement)
        self._take(measurement, 1)
        self.regulation.learn(measurement.regulation, measurement.anchor[_WARMTH])
        self.filters.log_evidence[: self.n] -= self.filters.log_evidence[: self.n].max()
        self.learnt[-1] = (*self.learnt[-1], measurement)

    def _worth_a_fit(self) -> Integers:
        """Filters that the data do not speak against, and the oldest step of each kind: it says what would be found."""
        n, filters = self.n, self.filters
        kind, shape, onset = filters.kind[:n], filters.shape[:n], filters.onset[:n]
        by_data = filters.log_evidence[:n] - filters.prior[:n, STATED] - filters.log_evidence[0]
        kept = (kind == HEALTHY) | (kind == GONE) | (shape == ARRIVAL) | (shape == ON_OFF) | (shape == OPEN)
        worth = kept | (by_data >= _HOPELESS)
        steps, oldest = shape == STEP, np.full(N_KINDS + 1, self.records)
        np.minimum.at(oldest, kind[steps], onset[steps])
        return np.flatnonzero(worth | (steps & (onset == oldest[kind])))

    def _fit_anew(self) -> None:
        """Fit every filter to everything learnt since the base, linearised about where its own fit ends."""
        n, filters = self.n, self.filters
        kind = filters.kind[:n]
        fitted = (kind != GONE) & (filters.shape[:n] != ON_OFF) & (filters.shape[:n] != OPEN)
        rows = np.flatnonzero((kind == HEALTHY) | (fitted & (filters.onset[:n] >= self.base.records)))
        before = filters.log_evidence[0]
        history = history_of(self.learnt, self.base.records, self.freed)
        fit_anew(filters, rows, self.base, self.kinds, WALKS, history, self.alive, _MOST_PASSES)
        filters.log_evidence[rows] += before - filters.log_evidence[0]
        filters.log_evidence[:n] -= filters.log_evidence[:n].max()

    def rebase(self) -> None:
        """Let the history that fits go back to begin here; what set in before keeps the filter that it has."""
        self.base = Base(self.filters.mean[0].copy(), self.filters.covariance[0].copy(), self.records)
        self.learnt.clear()
        self.freed = nothing_freed()
        self.refits = self.records == 0

    def _pass_time(self) -> None:
        """Let every component wander from the last record to the next."""
        pass_time(self.filters, self.n, WALKS, 0.0 if self.reservoir_measured else UNMEASURED_RESERVOIR_WALK_BAR**2)
        self.regulation.pass_time()

    def _take(self, measurement: Measurement, iterations: int) -> None:
        lines, loaded = measurement.seen[-1] > ZERO, measurement.anchor[_LOAD] > _LEAST_LOAD_LPM
        self.lines_seen = self.lines_seen or bool(lines)
        self.alive = max(self.alive, N_STATE if loaded else N_LINES if lines else N_SLOW)
        step(self.filters, self.n, DIRECTIONS, measurement.reading, self.alive, iterations)

    def spawn(self, breadth: float = 1.0) -> None:
        """A fault of each kind and shape setting in now; the least likely old onset of a kind gives way.

        ``breadth`` is how many times its kind's scale a fault may be that nothing bounds.
        """
        scales = scales_of(breadth)
        self.n = spawned(self.filters, self.n, self.records, self.kinds, self._most_onsets(), scales)
        self.regulation.spawn()

    def _most_onsets(self) -> Integers:
        """How many onsets are kept by shape and kind."""
        return most_onsets(lines=self.lines_seen, reservoir=self.reservoir_measured)

    def reset(self, freed: Mapping[str, float | None], *, cures: bool = True) -> None:
        """Something touched some components: they are as unknown as in any pump of the population, and nothing else is.

        A fault of those components ends here. Where one was as likely as anything else, the healthy pump goes on from where
        that fault's filter stands. Where it was likelier than health, its end is one more explanation of what comes
        (``resolving``), and so is, at a price, that what was done cured nothing.

        Parameters
        ----------
        freed
            By component: None for the population's spread, or by how much it may differ from what it was.
        cures
            False where what was touched is no longer there, so that its faults cannot go on: after a move.
        """
        n, filters = self.n, self.filters
        kept = ~np.append(touched_by(freed), False)[filters.kind[:n]]
        ended = np.flatnonzero(~kept)
        took_over = False
        if len(ended):
            evidence = filters.log_evidence[:n]
            likeliest = int(ended[evidence[ended].argmax()])
            kind, lead = int(filters.kind[likeliest]), evidence[likeliest] - evidence[0]
            took_over = bool(evidence[likeliest] >= evidence.max() - _LEVEL_EVIDENCE)
            spare = [int(row) for row in ended if row != likeliest]
            if took_over:
                take_over(filters, likeliest)
                kept[likeliest] = cures and lead > _BEYOND_DOUBT
            elif lead > _LEVEL_EVIDENCE:
                # there is room for so many ends and no more: the least likely gives way
                gone = np.flatnonzero(filters.kind[:n] == GONE)
                if len(gone) >= MOST_ONSETS[STEP, GONE]:
                    kept[gone[evidence[gone].argmin()]] = False
                kept[likeliest] = cures and bool(spare)
                end = spare[0] if kept[likeliest] else likeliest
                end_fault(filters, likeliest, end, self.records)
                kept[end] = True
            if kept[likeliest] and filters.kind[likeliest] == kind:
                filters.log_evidence[likeliest] += _CURED_NOTHING
                filters.prior[likeliest] += _CURED_NOTHING
            if lead > _BEYOND_DOUBT:
                self.ended, self.resolving = (kind, HEALTHY) if took_over else (HEALTHY, kind)
        self._keep(np.flatnonzero(kept))
        if "setting" in freed and freed["setting"] is None:
            # the compensator was opened: it regulates as it does now
            self.regulation = Regulation()
        if took_over:
            self.rebase()
        mean, sd = prior(self.pump)
        for name, like_before in freed.items():
            if like_before is not None:
                self._free(PLACE[name], np.nan, like_before)
            elif PLACE[name] < N_STATE:
                self._free(PLACE[name], mean[PLACE[name]], sd[PLACE[name]])

    def fill(self, ln_viscosity: float, sd: float) -> None:
        """Another fluid: the logarithm of its viscosity over that of the twin's, and its spread."""
        self._free(PLACE["ln_viscosity"], ln_viscosity, sd)

    def _keep(self, rows: Integers) -> None:
        """Drop every filter but these, in their order."""
        n = len(rows)
        for array in self.filters:
            array[:n] = array[rows]
        self.n = n

    def _free(self, place: int, mean: float, sd: float) -> None:
        """A component is unknown again, for every filter and in the history that filters are fitted anew to."""
        event = Freed(np.array([self.records]), np.array([place]), np.array([mean]), np.array([sd**2]))
        for f in range(self.n):
            free(self.filters.mean[f], self.filters.covariance[f], event, 0)
        self.freed = Freed(*(np.concatenate(pair) for pair in zip(self.freed, event, strict=True)))

    def _set_reservoir(self, measured: bool) -> None:
        spread = MEASURED_RESERVOIR_SD_BAR if measured else self.pump.population["reservoir_pressure_bar"].value
        self._free(PLACE["reservoir"], 0.0, spread)
        self.reservoir_measured = measured
