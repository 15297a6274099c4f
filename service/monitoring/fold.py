"""The fold: from everything that is known of one pump to its verdicts, one per record in event order. Pure."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from detectors.judgement.assessment import Fold
from detectors.judgement.snapshot import snapshot
from detectors.words.flights import roles_of
from detectors.words.observation import History
from detectors.words.verdict import Assessment, Verdict
from service.history.known import ALONE, Known, Observations, Others, PlacedRecord, pieces


@dataclass(frozen=True, slots=True)
class Start:
    """Where a fold is taken up: behind the first ``records`` records, with what it carried and the verdict's ``since``."""

    records: int
    fold: Fold
    since: datetime | None


@dataclass(frozen=True, slots=True)
class Step:
    """One record's assessment, with a snapshot of the fold behind it where one was asked for."""

    assessment: Assessment
    snapshot: bytes | None


def fold(known: Known, observations: Observations, others: Others = ALONE) -> tuple[Assessment, ...]:
    """Assess a pump's history from its first record on, record by record in event order.

    Where the surroundings change, what follows is judged in the new ones; what came before keeps its verdicts.
    """
    return tuple(step.assessment for step in steps(known, observations, others=others))


def steps(
    known: Known,
    observations: Observations,
    start: Start | None = None,
    snapshots_at: Collection[int] = (),
    others: Others = ALONE,
    until: int | None = None,
) -> Iterator[Step]:
    """Fold from a start on; the answers are those of a fold from the first record on.

    Parameters
    ----------
    start
        Taken from a fold of the same history up to there; None for the beginning.
    snapshots_at
        Numbers of records behind which a snapshot is wanted.
    others
        What records take over from other pumps.
    until
        Number of the last record that is assessed; None for the last there is.
    """
    carried = _carried_flags(known.placed)
    history = History((), known.maintenance, known.installation_changes)
    taken = start.records if start else 0
    state = start.fold.verdict.state if start and start.fold.verdict else None
    since = start.since if start else None
    last = len(known.placed) if until is None else until
    for first, end in pieces(known.placed):
        if end <= taken or first >= last:
            continue
        setting = known.placed[first].setting
        if start is not None and first < taken:
            held, begin = start.fold, taken
        else:
            # other surroundings: the whole history so far is seen with them
            kind = setting.pump_type(known.kind)
            healthy = known.healthy_in(setting)
            held, begin = Fold(kind, setting.circuit_parameters, known.thresholds, healthy), 0
        outlines = [p.outline for p in known.placed[:end]]
        roles = roles_of(outlines)
        ids = [o.record_id for o in outlines[begin : min(end, last)]]
        earlier = sorted({roles.adds_to[i] for i in ids if i in roles.adds_to} - set(ids))
        found = observations([*earlier, *ids])
        assessments = held.continued([found[i] for i in ids], roles, history, [found[i] for i in earlier], others)
        for number, assessment in enumerate(assessments, begin + 1):
            if number <= first:
                continue
            if assessment.verdict.state is not state or since is None:
                state, since = assessment.verdict.state, assessment.at
            verdict = _flagged(replace(assessment.verdict, since=since), carried[number - 1], known.remarks)
            kept = snapshot(held) if number in snapshots_at else None
            yield Step(replace(assessment, verdict=verdict), kept)


def _carried_flags(placed: Sequence[PlacedRecord]) -> list[Mapping[str, int]]:
    """Remarks on records, counted as long as the pump stays where it is: every verdict that rests on them has them."""
    found: list[Mapping[str, int]] = []
    carried: dict[str, int] = {}
    place = None
    for here in placed:
        if (here.outline.aircraft, here.outline.position) != place:
            place, carried = (here.outline.aircraft, here.outline.position), {}
        if here.flags:
            carried = dict(carried)
            for flag in here.flags:
                carried[flag] = carried.get(flag, 0) + 1
        found.append(carried)
    return found


def _flagged(verdict: Verdict, carried: Mapping[str, int], remarks: tuple[str, ...]) -> Verdict:
    if not carried and not remarks:
        return verdict
    flags = remarks + tuple(f"{flag} ({n} record{'s' if n > 1 else ''})" for flag, n in sorted(carried.items()))
    return replace(verdict, quality=replace(verdict.quality, flags=verdict.quality.flags + flags))
