"""Changes of what is refused and what is flagged: whole scales, contradictions, names."""

from benchmarks.mutants.catalogue import Mutant

_SCALES, _CONTRADICTIONS, _NAMES = (
    ("tests.service.test_scales",),
    ("tests.service.test_contradictions",),
    ("tests.service.test_names",),
)


def _scale(fragment: str, replacement: str) -> Mutant:
    return Mutant("quality", "service.ingest.scales", fragment, replacement, _SCALES)


def _contradiction(fragment: str, replacement: str) -> Mutant:
    select = "TestRemarks or from_a_lost_clock or samples_are"
    return Mutant("quality", "service.history.contradictions", fragment, replacement, _CONTRADICTIONS, select)


def _name(module: str, fragment: str, replacement: str, select: str) -> Mutant:
    return Mutant("quality", module, fragment, replacement, _NAMES, select)


def _doubt(module: str, fragment: str, replacement: str) -> Mutant:
    return Mutant("quality", module, fragment, replacement, ("tests.service.test_doubts",), "not postgres")


def _late(module: str, fragment: str, replacement: str) -> Mutant:
    return Mutant("folds", f"service.monitoring.{module}", fragment, replacement, ("tests.service.test_late_records",))


def _behind(module: str, fragment: str, replacement: str) -> Mutant:
    tests = ("tests.service.test_entries_behind",)
    return Mutant("folds", f"service.monitoring.{module}", fragment, replacement, tests, "sqlite")


MUTANTS: tuple[Mutant, ...] = (
    _scale("most = running or off", "most = off or running"),
    _scale("_BEYOND = 1.25", "_BEYOND = 0.9"),
    _scale("if most is None or full_scale is None or _scatters(most):", "if most is None or full_scale is None:"),
    _scale("full_scales.get(name) or (sensor", "(sensor"),
    _contradiction("here.hours < before.hours - tolerance", "here.hours < before.hours + tolerance"),
    _contradiction("return not _fewer(before, after, CLEARLY_HOURS)", "return True"),
    _contradiction("if said.flight_id == here.flight_id and same_place:", "if False:"),
    _doubt("service.ingest.doubts", "if rise > -_FALL_BAR:", "if rise < _FALL_BAR:"),
    _doubt("service.ingest.doubts", "or _is_a_period(step):", "or not _is_a_period(step):"),
    _doubt("service.history.contradictions", "if fewer and agree else", "if agree else"),
    _late("refold", "Pump.revision == pump.revision, ", ""),
    _late("settling", "if self._left.get(pump_id) is not held:", "if False:"),
    _late("folded", "is_whole = end == len(links)", "is_whole = True"),
    _behind("behind", "take_over(pump, whole=False)", "take_over(pump, whole=True)"),
    _behind("telling", "if news.to_all:", "if False:"),
    _behind("renewal", "or_(counts, judged)", "counts"),
    _behind("counting", '{"made_with": None, ', "{"),
    _name("service.ingest.names", 'if name in (".", ".."):', 'if name == ".":', "refused_with_the_reason"),
    _name("service.web.whole_names", '.replace("/", _STAND_IN)', "", "end_of_another"),
)
