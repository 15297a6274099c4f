"""From a decision to the verdict that is said: sentences, numbers and candidates that agree with each other."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime

from detectors.judgement import wording
from detectors.judgement.coverage import Coverage, blind_spots, missing_evidence
from detectors.judgement.estimates import Found
from detectors.judgement.isolation import Decision, Evidence, secondary
from detectors.judgement.plausibility import Doubt
from detectors.judgement.sight import Sight
from detectors.words.verdict import (
    CAUSES,
    SIDE_OF,
    UNINFORMED,
    BlindSpot,
    CasePressure,
    Fit,
    Intermittent,
    Quality,
    Resolved,
    Side,
    State,
    Verdict,
)

_RESIDUE = 0.05
"""Probability of all that the record's implausibility does not point to (our estimate: one such run in twenty has another
cause)."""


@dataclass(frozen=True, slots=True)
class Context:
    """What a verdict says beside its decision.

    ``missing`` counts the records that a baseline still needs, ``settling`` those that the position's reference needs after
    a move; ``sensor`` is the channel of the likeliest sensor fault; ``sight`` is what the type's records can show.
    """

    quality: Quality
    since: datetime
    limit_lpm: float
    missing: int
    coverage: Coverage
    settling: int
    fit: Fit
    intermittent: Intermittent | None
    resolved_by: Resolved | None
    case_pressure: CasePressure | None
    sensor: str | None
    sight: Sight


def verdict_of(decision: Decision, found: Evidence, sizes: Found, context: Context) -> Verdict:
    """The verdict by the evidence."""
    state = decision.state
    probabilities: Mapping[State, float] = found.probabilities
    if state is State.INSUFFICIENT_DATA:
        probabilities = UNINFORMED
    blind = blind_spots(context.coverage, sizes.smallest, context.settling, context.sight)
    missing = missing_evidence(decision.candidates, context.coverage, context.sight)
    sensor = context.sensor if State.SENSOR_FAULT in (state, *decision.candidates) else None
    said = wording.Said(
        state=state,
        candidates=decision.candidates,
        probabilities=probabilities,
        values=sizes.values,
        beyond=sizes.beyond,
        limit_lpm=context.limit_lpm,
        missing=context.missing,
        sensor=sensor,
        blind=blind,
        intermittent=context.intermittent,
        coverage=context.coverage,
        evidence=missing,
    )
    return Verdict(
        state=state,
        side=side_of(decision),
        since=context.since,
        confidence=max(probabilities.values()),
        probabilities=probabilities,
        candidates=decision.candidates,
        secondary=secondary(found, state),
        sensor=sensor,
        estimates=sizes.values,
        minimum_detectable=sizes.smallest,
        quality=context.quality,
        advice=wording.advice(said),
        resolving_measurement=missing[0].what if missing else None,
        fit=context.fit,
        blind_spots=blind,
        probability_beyond_limit=sizes.beyond if context.quality.records_used else None,
        intermittent=context.intermittent,
        resolved_by=context.resolved_by,
        missing_evidence=missing,
        case_pressure=context.case_pressure,
    )


def implausible(found: Doubt, records: int, judged: Verdict, at: datetime) -> Verdict:
    """The verdict where the last records cannot be true: what was known of pump and circuit before stays an estimate."""
    decision = Decision(State.SENSOR_FAULT)
    if len(found.states) > 1:
        decision = Decision(State.INDETERMINATE, tuple(found.states))
    probabilities = _spread(found.states)
    return replace(
        judged,
        state=decision.state,
        side=side_of(decision),
        since=judged.since if judged.state is decision.state else at,
        confidence=max(probabilities.values()),
        probabilities=probabilities,
        candidates=decision.candidates,
        secondary=None,
        sensor=found.channel,
        advice=wording.implausible(found.channel, found.why, records),
        resolving_measurement=wording.gauge(found.channel),
        missing_evidence=wording.gauge_evidence(found.channel, found.states),
    )


def said_with(judged: Verdict, unjudged: int) -> Verdict:
    """The verdict with what its last records add to it, whatever it was judged by.

    ``unjudged`` records lie outside the type's measured curve, with no twin to judge them by; a case pressure beyond the
    plain rule is said first, and nobody flies on beside it.
    """
    pressure = judged.case_pressure
    if pressure is not None and pressure.beyond:
        judged = replace(judged, advice=wording.beyond_case_limit(judged.advice, pressure))
    if not unjudged:
        return judged
    why = f"the last {unjudged} record(s) lie outside the measured healthy curve and are not judged"
    spot = BlindSpot("case_flow_at_reference_lpm", None, why)
    return replace(
        judged,
        blind_spots=(*judged.blind_spots, spot),
        advice=f"Nothing is known since {unjudged} record(s): they lie outside the measured healthy curve. {judged.advice}",
    )


def side_of(decision: Decision) -> Side:
    """Side of a state; for ``indeterminate`` the one its candidates share."""
    sides = {SIDE_OF[c] for c in decision.candidates}
    return sides.pop() if len(sides) == 1 else SIDE_OF[decision.state]


def _spread(states: tuple[State, ...]) -> dict[State, float]:
    """Probabilities where only a few states are left: equal among them, a residue for the others."""
    others = [s for s in CAUSES if s not in states]
    return {s: (1.0 - _RESIDUE) / len(states) if s in states else _RESIDUE / len(others) for s in CAUSES}
