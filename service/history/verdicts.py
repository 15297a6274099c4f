"""The verdict of a pump of which nothing is known yet."""

from detectors.judgement.version import twin_version
from detectors.judgement.wording import keep_recording
from detectors.words.verdict import SIDE_OF, UNINFORMED, Quality, State, Verdict
from service.answers import verdicts as answers
from service.history.codec import verdict_to_json
from service.identity import software
from service.thresholds.layers import Effective
from twin.parameters import PumpType


def empty_verdict(kind: PumpType, thresholds: Effective) -> answers.Verdict:
    """Verdict of a pump without records."""
    missing = int(thresholds.values["baseline_records"])
    state = State.INSUFFICIENT_DATA
    verdict = Verdict(
        state=state,
        side=SIDE_OF[state],
        since=None,
        confidence=max(UNINFORMED.values()),
        probabilities=UNINFORMED,
        candidates=(),
        secondary=None,
        sensor=None,
        estimates={},
        minimum_detectable={},
        quality=Quality(0, 0, "nominal", ()),
        advice=keep_recording(missing),
        resolving_measurement=None,
    )
    return verdict_to_json(verdict, twin_version(kind), thresholds.version, software().to_json())
