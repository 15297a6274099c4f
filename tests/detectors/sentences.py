"""What every verdict must keep: its words say what its numbers say."""

import re
from collections.abc import Mapping

from detectors.judgement.coverage import Coverage
from detectors.words.observation import Observation
from detectors.words.states import FAULTS, SIDE_OF, Side, State
from detectors.words.verdict import Verdict

ASKED = {
    "pump-off": lambda c: c.zeros >= 0.5 * c.records,
    "ground runs": lambda c: c.loaded >= 4,
    "bursts": lambda c: c.bursts >= 10,
    "different fluid temperatures": lambda c: c.span_k >= 20.0,
    "load steps": lambda c: c.steps >= 2,
}
"""What may be asked for, and whether a history holds it already."""


def disagreements(verdict: Verdict, held: Coverage, thresholds: Mapping[str, float]) -> list[str]:
    """Every word of a verdict that a number beside it contradicts; ``held`` is what its history holds."""
    found: list[str] = []

    def check(name: str, holds: bool) -> None:
        if not holds:
            found.append(f"{name}: {verdict.state} {dict(verdict.probabilities)} | {verdict.advice}")

    p, text, flow = verdict.probabilities, verdict.advice, verdict.estimates.get("case_flow_at_reference_lpm")
    limit, beyond = thresholds["case_flow_limit_lpm"], verdict.probability_beyond_limit
    check("probabilities sum to one", abs(sum(p.values()) - 1.0) < 1e-9 and min(p.values()) >= -1e-12)
    check("confidence is the largest of them", verdict.confidence == max(p.values()))
    for estimate in verdict.estimates.values():
        check("an interval holds its mean", estimate.low <= estimate.mean <= estimate.high)
    if verdict.state is State.INSUFFICIENT_DATA:
        return found
    if verdict.state is State.INDETERMINATE:
        check("undecided between two at least", len(verdict.candidates) >= 2)
        check("no cause above 0.98 beside undecided", max(p[c] for c in FAULTS) <= 0.98 and p[State.HEALTHY] <= 0.98)
        sides = {SIDE_OF[c] for c in verdict.candidates}
        check("the side is its candidates'", verdict.side is (sides.pop() if len(sides) == 1 else Side.UNKNOWN))
        check("no pump is replaced while undecided", "Replace the pump" not in text and FLY_ON not in text)
        check("what would tell is said", verdict.resolving_measurement == verdict.missing_evidence[0].what)
        check("and in the advice", verdict.missing_evidence[0].what in text)
        shares = [int(s) for s in re.findall(r"\((\d+) %\)", text)]
        check("shares are falling", shares == sorted(shares, reverse=True))
    else:
        check("what is named has no rivals", verdict.candidates == () and verdict.resolving_measurement is None)
    if verdict.state in FAULTS and verdict.side is not Side.SENSOR and "on the last" not in text:
        leading = max(p, key=lambda s: p[s])
        check("the named cause leads", leading in (verdict.state, State.HEALTHY) or verdict.state is leading)
    is_beyond = (beyond or 0.0) >= 0.5 or (flow is not None and flow.mean > limit)
    pressed = verdict.case_pressure is not None and verdict.case_pressure.beyond
    check("nobody flies on beyond a limit", FLY_ON not in text or not (is_beyond or pressed))
    check("nobody flies on where change is likelier", FLY_ON not in text or p[State.HEALTHY] >= 0.5)
    check("nobody flies on with a fault", FLY_ON not in text or verdict.state is State.HEALTHY)
    check("a pump is replaced beyond its limit only", "Replace the pump" not in text or is_beyond)
    check("nothing changed where nothing did", "Nothing has changed" not in text or verdict.state is State.HEALTHY)
    for numbers in re.findall(r"grown by ([\d.]+) L/min \(([\d.-]+) to", text):
        check("what has grown has grown for sure", float(numbers[1]) >= 0.0)
    for low in re.findall(r"(?:leak about [\d.]+ L/min|grown by [\d.]+ %) \((-?[\d.]+) to", text):
        check("what leaks more leaks more for sure", float(low) >= 0.0)
    first = text.split(". ")[0]
    for spot in verdict.blind_spots:
        check(f"the first sentence says: {spot.because}", spot.because.split(". ")[0] in first or pressed)
    for evidence in verdict.missing_evidence:
        check("as many records as are asked for", evidence.records >= 1)
        for words, holds in ASKED.items():
            check(f"asks for {words} that it holds", words not in evidence.what or not holds(held))
    for words, holds in ASKED.items() if verdict.side is not Side.SENSOR else ():
        check(f"advises {words} that it holds", words not in text or not holds(held))
    return found


FLY_ON = "Fly on"


def held_by(observations: list[Observation]) -> list[Coverage]:
    """What a history holds after each of its records."""
    found, coverage = [], Coverage()
    for observation in observations:
        coverage = coverage.grown(observation)
        found.append(coverage)
    return found
