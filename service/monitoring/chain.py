"""Chains: a running hash, link by link, over everything that a pump's verdicts were folded from.

Two histories whose links agree at a place agree in everything before it that an answer depends on. Stored assessments
and snapshots carry their link, so that whether they still hold is seen and need never be remembered.
"""

import hashlib
from functools import cache
from itertools import pairwise
from typing import Any

from detectors.judgement import succession
from detectors.judgement.snapshot import judge_version
from detectors.words.flights import roles_of
from service.history import codec
from service.history.known import Known, PlacedRecord, pieces
from service.monitoring import fold
from twin.sources import sources_hash


def chain(known: Known, *versions: object) -> list[str]:
    """One link per record of a history, in event order.

    Parameters
    ----------
    versions
        What stored verdicts say of their origin besides, e.g. the versions of twin and thresholds.
    """
    links: list[str] = []
    last = ""
    for first, end in pieces(known.placed):
        for here, link in zip(known.placed[first:end], _of_piece(known, first, end, versions)[first:], strict=True):
            last = _link(last, link, here.flags, *known.remarks)
            links.append(last)
    return links


def _of_piece(known: Known, first: int, end: int, versions: tuple[object, ...]) -> list[str]:
    """Links of the history up to ``end`` as the surroundings of the record at ``first`` show it."""
    placed = known.placed[:end]
    surroundings = placed[first].setting
    roles = roles_of([p.outline for p in placed])
    judged = (surroundings.pump_type(known.kind), surroundings.circuit_parameters, sorted(known.thresholds.items()))
    links = [_link(judge_version(), own_sources(), repr(judged), *map(str, versions))]
    between = [[], *(_between(known, a, b) for a, b in pairwise(placed))]
    for here, events in zip(placed, between, strict=True):
        outline = here.outline
        names = (outline.record_id, outline.aircraft, outline.position, outline.flight_id, outline.segment)
        role = (outline.record_id in roles.counted, roles.adds_to.get(outline.record_id))
        borrowed = known.borrowed.get(outline.record_id, ())
        links.append(_link(links[-1], outline.at.isoformat(), names, here.digest, role, events, borrowed))
    return links[1:]


def _between(known: Known, a: PlacedRecord, b: PlacedRecord) -> list[tuple[str, ...]]:
    """What happened to the pump between two records."""
    after, until = a.outline.at, b.outline.at
    happened: list[tuple[str, ...]] = [
        (t.isoformat(), "installation") for t in known.installation_changes if after < t <= until
    ]
    happened += [
        (m.at.isoformat(), m.action, m.fluid or "", m.channel or "") for m in known.maintenance if after < m.at <= until
    ]
    return sorted(happened)


def _link(*parts: Any) -> str:
    # tuples of texts, truth values and None: their repr is unambiguous, the same everywhere, and quick
    return hashlib.sha256(repr(parts).encode()).hexdigest()


@cache
def own_sources() -> str:
    """Hash of the code between the judge and a stored assessment, and of who takes over from whom."""
    return sources_hash(codec.__name__, fold.__name__, succession.__name__)
