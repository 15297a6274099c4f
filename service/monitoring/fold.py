"""The fold: from everything that is known of one pump to its verdicts, one per record in event order. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from detectors.assessment import assess
from detectors.observation import History, Maintenance, Observation
from detectors.type_correction import HealthyCurve
from detectors.verdict import Assessment, Verdict
from service.monitoring.setting import Setting
from twin.parameters import PumpType


@dataclass(frozen=True, slots=True)
class PlacedObservation:
    """A record where the pump really sat, in its surroundings; ``flags`` are remarks on this record."""

    observation: Observation
    setting: Setting
    flags: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Known:
    """Everything that a pump's verdicts are a function of, apart from the twin's version.

    ``healthy`` is the pump type's measured curve that stands in for the twin's, None where nobody has measured one.
    """

    kind: PumpType
    thresholds: Mapping[str, float]
    placed: tuple[PlacedObservation, ...]
    maintenance: tuple[Maintenance, ...] = ()
    installation_changes: tuple[datetime, ...] = ()
    healthy: HealthyCurve | None = None


def fold(known: Known) -> tuple[Assessment, ...]:
    """Assess a pump's history, record by record in event order.

    Parameters
    ----------
    known
        Observations in any order. Where the surroundings change, what follows is judged in the new ones; what came
        before keeps its verdicts.

    Returns
    -------
    tuple of Assessment
        One per observation; the same input in any order gives the same answer.
    """
    placed = sorted(known.placed, key=lambda p: (p.observation.at, p.observation.record_id))
    assessments: list[Assessment] = []
    for start, end in _pieces([p.setting for p in placed]):
        setting = placed[start].setting
        history = History(tuple(p.observation for p in placed[:end]), known.maintenance, known.installation_changes)
        kind = setting.pump_type(known.kind)
        assessments += assess(history, kind, setting.circuit_parameters, known.thresholds, known.healthy)[start:]
    return _with_flags(_with_since(assessments), placed)


def _pieces(settings: Sequence[Setting]) -> list[tuple[int, int]]:
    """Stretches of equal settings as (start, end)."""
    starts = [i for i, setting in enumerate(settings) if i == 0 or setting != settings[i - 1]]
    return list(zip(starts, [*starts[1:], len(settings)], strict=True)) if starts else []


def _with_since(assessments: Sequence[Assessment]) -> list[Assessment]:
    """Starts of the unbroken runs of a state, across pieces that were assessed apart."""
    found: list[Assessment] = []
    for assessment in assessments:
        verdict = assessment.verdict
        since = assessment.at
        if found and found[-1].verdict.state is verdict.state and found[-1].verdict.since is not None:
            since = found[-1].verdict.since
        found.append(replace(assessment, verdict=replace(verdict, since=since)))
    return found


def _with_flags(assessments: Sequence[Assessment], placed: Sequence[PlacedObservation]) -> tuple[Assessment, ...]:
    """Remarks on records, carried by every verdict that rests on them: as long as the pump stays where it is."""
    found: list[Assessment] = []
    carried: dict[str, int] = {}
    place = None
    for assessment, here in zip(assessments, placed, strict=True):
        if (here.observation.aircraft, here.observation.position) != place:
            place, carried = (here.observation.aircraft, here.observation.position), {}
        for flag in here.flags:
            carried[flag] = carried.get(flag, 0) + 1
        found.append(replace(assessment, verdict=_flagged(assessment.verdict, carried)))
    return tuple(found)


def _flagged(verdict: Verdict, carried: Mapping[str, int]) -> Verdict:
    if not carried:
        return verdict
    flags = tuple(f"{flag} ({n} record{'s' if n > 1 else ''})" for flag, n in sorted(carried.items()))
    return replace(verdict, quality=replace(verdict.quality, flags=verdict.quality.flags + flags))
