"""What a verdict says besides its headline, in words: how well it fits, what it cannot see, what is missing, what may come."""

from collections.abc import Callable
from datetime import datetime
from typing import NamedTuple

from detectors.words.states import row_of
from detectors.words.verdict import ESTIMATES
from service.answers.verdicts import BlindSpot, MissingEvidence, Verdict
from service.reports.sentences import in_units
from service.reports.words import ACTION_WORDS, ESTIMATE_NAMES
from service.units import METRIC, UnitSystem


class Remark(NamedTuple):
    """A heading and its sentences; neither holds markup."""

    heading: str
    sentences: tuple[str, ...]


def remarks(verdict: Verdict, system: UnitSystem = METRIC) -> list[Remark]:
    """Remarks on a verdict in the shape of the API; nothing of what it does not say, nor of what older releases knew not.

    Numbers are in the reader's units, also where the verdict brings them as words.
    """
    found = [Remark(heading, tuple(said(verdict, system))) for heading, said in _SAID]
    return [remark for remark in found if remark.sentences]


def steps(verdict: Verdict, system: UnitSystem = METRIC) -> list[str]:
    """What to do one after the other: the advice, what would tell, what is still to be recorded, and to write it down."""
    resolving = verdict["resolving_measurement"]
    found = [verdict["advice"], *([] if resolving is None else [f"What would tell: {resolving}."])]
    found += [
        f"Record {_evidence(item, METRIC)}."
        for item in verdict.get("missing_evidence", [])
        if item["what"] != resolving
    ]
    found = [in_units(step, system) for step in found]
    return [*found, "Enter what was found and what was done on the page of the pump: verdicts rest on it."]


def _fit(verdict: Verdict, _system: UnitSystem) -> list[str]:
    fit = verdict.get("fit")
    if fit is None or fit["records"] == 0:
        return []
    last = "the last record" if fit["records"] == 1 else f"the last {fit['records']} records"
    words = f"explains {fit['explained']} of {last}"
    return [words if fit["since"] is None else f"{words}; none since {_day(fit['since'])}"]


def _blind_spots(verdict: Verdict, system: UnitSystem) -> list[str]:
    return [_blind_spot(spot, system) for spot in verdict.get("blind_spots", [])]


def _blind_spot(spot: BlindSpot, system: UnitSystem) -> str:
    name, unit = spot["quantity"], ESTIMATES.get(spot["quantity"], "")
    words = ESTIMATE_NAMES.get(name, name).removesuffix(", change")
    size = "of any size"
    if spot["below"] is not None:
        size = f"below {system.value(spot['below'], unit):.2g} {system.word(unit)}".rstrip()
    return f"{words}: changes {size} stay unseen, because {in_units(spot['because'], system)}"


def _intermittent(verdict: Verdict, _system: UnitSystem) -> list[str]:
    found = verdict.get("intermittent")
    if found is None:
        return []
    return [f"{_word(found['state'])} on {found['records']} of {found['of']} records, first on {_day(found['since'])}"]


def _resolved(verdict: Verdict, _system: UnitSystem) -> list[str]:
    found = verdict.get("resolved_by")
    if found is None:
        return []
    done = " and ".join(_action(action) for action in found["action"].split("+"))
    return [f"{_word(found['state'])} ended on {_day(found['at'])}: {done}"]


def _missing(verdict: Verdict, system: UnitSystem) -> list[str]:
    return [_evidence(item, system) for item in verdict.get("missing_evidence", [])]


def _evidence(item: MissingEvidence, system: UnitSystem) -> str:
    count = f"{item['records']} record{'' if item['records'] == 1 else 's'}"
    between = " and ".join(_word(cause) for cause in item["would_decide"])
    return f"{in_units(item['what'], system)}, {count}" + (f": would decide between {between}" if between else "")


def _limit(verdict: Verdict, _system: UnitSystem) -> list[str]:
    said = []
    beyond, crossing = verdict.get("probability_beyond_limit"), verdict.get("crossing")
    if beyond is not None:
        said.append(f"case flow at the reference condition is beyond its limit with a probability of {_share(beyond)}")
    if crossing is not None:
        hours = f"{crossing['within_flight_hours']:g} flight hours"
        said.append(f"it crosses the limit within {hours} with a probability of {_share(crossing['probability'])}")
    return said


def _case_pressure(verdict: Verdict, system: UnitSystem) -> list[str]:
    rule = verdict.get("case_pressure")
    if rule is None:
        return []
    said = "beyond the rule, whatever the cause" if rule["beyond"] else "within the rule"
    over = system.said(rule["over_reservoir_bar"], "bar", 2)
    reference = system.said(rule["reference_bar"], "bar", 2)
    return [
        f"{over} over the reservoir on the last flight: {said} (twice this pump's own reference of {reference}, or "
        f"{system.said(rule['limit_bar'], 'bar')})"
    ]


_SAID: tuple[tuple[str, Callable[[Verdict, UnitSystem], list[str]]], ...] = (
    ("The leading cause", _fit),
    ("Cannot be seen", _blind_spots),
    ("Comes and goes", _intermittent),
    ("Resolved", _resolved),
    ("Still missing", _missing),
    ("Limit", _limit),
    ("Case pressure", _case_pressure),
)


def _word(state: str) -> str:
    return row_of(state).word


def _action(action: str) -> str:
    words = ACTION_WORDS.get(action, action.replace("_", " "))
    return words[:1].lower() + words[1:]


def _day(instant: str) -> str:
    return f"{datetime.fromisoformat(instant):%d %b %Y}"


def _share(probability: float) -> str:
    """A probability in per cent that never says 0 or 100 where it is neither."""
    percent = 100.0 * probability
    if 0.0 < percent < 1.0:
        return "less than 1 %"
    return "more than 99 %" if 99.0 < percent < 100.0 else f"{percent:.0f} %"
