"""Changes of what is measured, weighed and said: reduction, bank, judgement."""

from benchmarks.mutants.catalogue import Mutant

_BY_TIME = "tests.detectors.test_windows_by_time"
_WINDOWS, _STATISTICS = ("tests.detectors.test_windows", _BY_TIME), ("tests.detectors.test_statistics_referee",)
_STEPS = ("tests.detectors.test_load_steps",)
_ASSESSMENT, _ISOLATION = ("tests.detectors.test_assessment",), ("tests.detectors.test_isolation",)
_EVENTS, _MEMORY = ("tests.detectors.test_events",), ("tests.detectors.test_memory",)
_SUCCESSION, _POPULATION = ("tests.detectors.test_succession",), ("tests.detectors.test_population",)
_PLAUSIBILITY, _COVERAGE = ("tests.detectors.test_plausibility",), ("tests.detectors.test_coverage",)
_STAND_IN, _SIGHTED = ("tests.detectors.test_stand_in",), ("tests.detectors.test_partly_sighted",)
_SPREADS = ("tests.detectors.test_bank_rules",)


def _reduction(module: str, fragment: str, replacement: str, tests: tuple[str, ...] = _WINDOWS) -> Mutant:
    return Mutant("reduction", module, fragment, replacement, tests)


def _bank(module: str, fragment: str, replacement: str, *, plain: bool = False) -> Mutant:
    return Mutant("bank", module, fragment, replacement, _SPREADS, plain=plain)


def _judgement(
    module: str, fragment: str, replacement: str, select: str = "", tests: tuple[str, ...] = _ASSESSMENT
) -> Mutant:
    return Mutant("judgement", module, fragment, replacement, tests, select)


def _curve(module: str, fragment: str, replacement: str) -> Mutant:
    return Mutant("curve", f"detectors.curve.{module}", fragment, replacement, ("tests.detectors.test_curve",))


MUTANTS: tuple[Mutant, ...] = (
    _reduction("detectors.reduction.windows", "_swing(part), share * sensor", "_swing(part), 2.0 * share * sensor"),
    _reduction("detectors.words.numbers", "LOWEST_PRESSURE_SHARE = 0.85", "LOWEST_PRESSURE_SHARE = 0.5"),
    _reduction("detectors.reduction.windows", "LOWEST_SPEED_FRACTION = 0.7", "LOWEST_SPEED_FRACTION = 0.5"),
    _reduction("detectors.reduction.windows", "100.0 * speed > band * centre", "50.0 * speed > band * centre"),
    _reduction("detectors.reduction.windows", "if drift > limit:", "if drift > 2.0 * limit:"),
    _reduction("detectors.words.numbers", "MOST_MISSING = 0.2", "MOST_MISSING = 1.0"),
    _reduction("detectors.reduction.windows", "zero & known & ~flowing", "zero & ~flowing"),
    _reduction("detectors.reduction.windows", "quiet = ~(activity > ", "quiet = (activity >= 0.0) | ~(activity > "),
    _reduction("detectors.reduction.windows", "- held) > step", "- held) > 100.0 * step"),
    _reduction("detectors.reduction.conditioning", "_GAP_IN_STEPS = 1.5", "_GAP_IN_STEPS = 15.0"),
    _reduction("detectors.reduction.conditioning", '"shaft_speed_rpm": 10.0', '"shaft_speed_rpm": 1.0'),
    _reduction("detectors.reduction.conditioning", "in_long_gaps > MOST_MISSING * whole or ", ""),
    _reduction("detectors.reduction.zero", "settles=has_run and not part", "settles=first > 0 and not part"),
    _reduction("detectors.reduction.zero", "SETTLING_AFTER_SHUTDOWN_S = 30.0", "SETTLING_AFTER_SHUTDOWN_S = 0.0"),
    _reduction("detectors.reduction.zero", "abs(b.mean - a.mean), 0.01 *", "abs(b.mean - a.mean), 1.0 *"),
    _reduction("detectors.reduction.zero", "UNMEASURED_RESERVOIR_SD_BAR = 0.10", "UNMEASURED_RESERVOIR_SD_BAR = 0.01"),
    _reduction("detectors.reduction.zero", "PUMP_OFF_SPEED_FRACTION = 0.05", "PUMP_OFF_SPEED_FRACTION = 0.2"),
    _reduction("detectors.reduction.statistics", "SPIKE_SIGMAS = 6.0", "SPIKE_SIGMAS = 8.0", _STATISTICS),
    _reduction("detectors.reduction.statistics", "/ covariance[0] - 1.0))", "/ covariance[0]))", _STATISTICS),
    _reduction("detectors.reduction.statistics", "np.sqrt(12.0 * n)", "np.sqrt(n)", _STATISTICS),
    _reduction("detectors.reduction.statistics", "max(n - tau, 0.5 * n / (n - 1))", "max(n - 1.0, 0.5)", _STATISTICS),
    _reduction("detectors.reduction.statistics", "block_s + 1.0e-6)", "block_s - 1.0e-6)", _STATISTICS),
    _reduction(
        "detectors.reduction.load_steps", "droop = -change / flow_change", "droop = change / flow_change", _STEPS
    ),
    _bank(
        "detectors.bank.hypotheses",
        '"setting": population["pressure_setting_bar"]',
        '"setting": 2.0 * population["pressure_setting_bar"]',
    ),
    _bank("detectors.bank.hypotheses", "variance[PLACE[name]] = sd**2", "variance[PLACE[name]] = sd"),
    _bank("detectors.bank.hypotheses", "row[INDEX[name]] = share", "row[INDEX[name]] = 1.0"),
    _bank(
        "detectors.bank.hypotheses", "hazards.get(kind.state, HAZARD)) * kind.share", "hazards.get(kind.state, HAZARD))"
    ),
    _bank(
        "detectors.bank.bank",
        "0.0 if self.reservoir_measured else UNMEASURED",
        "0.0 if self.reservoir_measured else 0.0 * UNMEASURED",
    ),
    _bank(
        "detectors.bank.tables",
        "if not reservoir:\n        most",
        "if reservoir:\n        most",
    ),
    _bank(
        "detectors.bank.kernel",
        "P[AMPLITUDE, AMPLITUDE] += P[AMPLITUDE, RATE]",
        "P[AMPLITUDE, AMPLITUDE] += 0.0",
        plain=True,
    ),
    _bank("detectors.bank.kernel", "m[AMPLITUDE] += m[RATE]", "m[AMPLITUDE] += 0.0", plain=True),
    _bank("detectors.bank.kernel", "m[RATE] *= GROWS_ON", "m[RATE] *= 1.0", plain=True),
    _bank("detectors.bank.kernel", "d -= A[j, k] * A[j, k]", "d -= A[j, k]", plain=True),
    _bank("detectors.bank.kernel", "return distance, 2.0 * math.log", "return distance, math.log", plain=True),
    _bank(
        "detectors.bank.kernel",
        "log_density = -0.5 * log_det - 0.5 * (STUDENT_DEGREES + k)",
        "log_density = -0.5 * log_det - 0.5 * STUDENT_DEGREES",
        plain=True,
    ),
    _judgement("twin.numbers", "Z_90 = 1.645", "Z_90 = 1.0", "nine_in_ten"),
    _judgement("detectors.judgement.estimates", "(1.0 - share) * spread**2", "spread**2", "nine_in_ten"),
    _judgement("detectors.judgement.readings", "half = Z_90 * residual", "half = 1.0 * residual", "nine_in_ten"),
    _judgement("detectors.judgement.readings", "half = Z_90 * mean", "half = 1.0 * mean", "nine_in_ten"),
    _judgement("detectors.judgement.events", '{"setting": _POPULATION}', "{}", "", _EVENTS),
    _judgement("detectors.judgement.plausibility", "TWICE = 2.0", "TWICE = 4.0", "", _PLAUSIBILITY),
    _judgement("detectors.judgement.plausibility", "_MOST_OFF_BAR = 25.0", "_MOST_OFF_BAR = 250.0", "", _PLAUSIBILITY),
    _judgement("detectors.judgement.plausibility", "_FOLLOWS = 0.5", "_FOLLOWS = 0.0", "", _PLAUSIBILITY),
    _judgement("detectors.judgement.plausibility", "_TOGGLING = 2", "_TOGGLING = 0", "", _PLAUSIBILITY),
    _judgement("detectors.judgement.succession", "earlier[-1].pump != first.pump", "earlier", "", _SUCCESSION),
    _judgement("detectors.judgement.succession", "len(next_ones) > 1 or ", "", "", _SUCCESSION),
    _judgement("detectors.judgement.handover", "FEWEST_RECORDS = 8", "FEWEST_RECORDS = 0", "", _SUCCESSION),
    _judgement("detectors.judgement.assessment", "self.bank.ended = known.position.blamed", "pass", "", _SUCCESSION),
    _judgement("detectors.bank.position", "_STAYS[kind] >= 0", "_STAYS[kind] > 99", "", _SUCCESSION),
    _judgement("detectors.judgement.population", "MOST_TIMES = 5.0", "MOST_TIMES = 50.0", "", _POPULATION),
    _judgement("detectors.judgement.memory", "showing.before) + showing.now", "showing.before) + 1", "", _MEMORY),
    _judgement("detectors.judgement.memory", "_LEAST_RECORDS = 3", "_LEAST_RECORDS = 1", "", _MEMORY),
    _judgement("detectors.judgement.coverage", "_LOADED - history.loaded", "_LOADED", "", _COVERAGE),
    _judgement(
        "detectors.judgement.assessment", "key=lambda o: (o.at, o.record_id))", "key=lambda o: o.at)", "instant"
    ),
    _judgement("detectors.judgement.assessment", "if missing <= 0:", "if missing < 0:"),
    _judgement("detectors.judgement.isolation", "alarm.above + 1 if", "alarm.above if", "", _ISOLATION),
    _judgement("detectors.judgement.isolation", "_KEPT = 0.82", "_KEPT = 1.0", "", _ISOLATION),
    _judgement(
        "detectors.judgement.isolation",
        'thresholds["alarm_off_log_odds"]',
        'thresholds["alarm_on_log_odds"]',
        "",
        _ISOLATION,
    ),
    _judgement("detectors.judgement.isolation", "share[f])[-2:]", "share[f])[-1:]", "", _ISOLATION),
    _judgement("detectors.judgement.isolation", "WORN_RECORDS = 4", "WORN_RECORDS = 6", "", _ISOLATION),
    _judgement(
        "detectors.words.flights", "and outline.segment is None", "and False", "", ("tests.detectors.test_flights",)
    ),
    _judgement(
        "detectors.words.flights", "elif outline.has_spectrum and", "elif", "", ("tests.detectors.test_flights",)
    ),
    _judgement(
        "detectors.words.flights", "if not outline.has_zero_flow:", "if False:", "", ("tests.detectors.test_flights",)
    ),
    _curve("sights", "within + (apart.T * sight.shares) @ apart", "within * 0.25"),
    _curve("sights", "own[list(_OF_SENSORS)] = 0.0", "own[list(_OF_SENSORS[:0])] = 0.0"),
    _curve("sights", "states[:, _SYSTEM] += demand_lpm", "states[:, _SYSTEM] += 0.5 * demand_lpm"),
    _curve("points", "y + zero - first", "y"),
    _curve("points", "- zero\n    sd", "\n    sd"),
    _curve("points", "kind.sign == 0", "kind.sign != 0"),
    _curve("laws", "if amplitude >= largest:", "if False:"),
    _curve("laws", "np.array([e.standard_deviation for e in fitted]) ** -2.0", "np.ones(len(fitted))"),
    _reduction(
        "detectors.expectation.stand_in", 'row[COLUMN["drain"]] *= ratio', 'row[COLUMN["drain"]] *= 1.0', _STAND_IN
    ),
    _reduction("detectors.expectation.type_correction", "WARMING_MARGIN = 1.0", "WARMING_MARGIN = 10.0", _STAND_IN),
    _judgement("detectors.judgement.sight", "return FAULTS\n", "return ()\n", "", _SIGHTED),
    _judgement("detectors.judgement.coverage", "if channel in sight.lacks", "if False", "", _SIGHTED),
    _curve("labels", "and self.top < other.bottom", "and self.top < other.top"),
)
