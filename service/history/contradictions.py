"""What records say against one another: the same samples twice, two flights at once, hours against dates.

Nothing here is refused: remarks on the records, which every verdict that rests on them carries. They follow from the
records that count alone, in event order, whatever order they came in.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise
from typing import TypeAlias

from detectors.words.observation import Maintenance
from service.ingest.names import look_of

Remarks: TypeAlias = dict[str, list[str]]

HOURS_TOLERANCE = 1.0
"""Flight hours are rounded, and said at the start of a flight or at its end [h] (our choice)."""
CLEARLY_HOURS = 5.0
"""What no rounding explains: longer than any flight of these helicopters [h]."""
OVERLAP_TOLERANCE = timedelta(seconds=60.0)
"""Clocks of two recorders differ by as much (our choice)."""
LONGEST_SILENCE = timedelta(days=5 * 365)
"""Years without a record are likelier a clock that was lost (our choice)."""
_MOST_AGREE = 3
"""Records whose dates and hours agree against the one before them."""
OVERHAUL = "pump_overhauled"
MISDATED = (
    "its date is not that of its flight, as the records behind it show: it is evidence of nothing until it is corrected"
)
HOURS_BACKWARDS = "flight hours run against the dates: a recorder's clock was lost, or hours were counted anew"
HOURS_TOO_FAST = "flight hours grow faster than time: a recorder's clock was lost, or the hours are not hours"
COPIED_ELSEWHERE = "another pump has a record with the same samples"
PLACE_TAKEN = "another pump says that it sat in the same place at the same time"
SILENCE = "records lie more than five years apart: a recorder's clock may have been lost"


@dataclass(frozen=True, slots=True)
class Said:
    """What one record says of itself; ``until`` is None where nobody has looked at its samples yet."""

    record_id: str
    pump: str
    flight_id: str
    segment: str
    aircraft: str
    position: str
    at: datetime
    until: datetime | None
    hours: float | None
    samples_hash: str | None
    pump_id: int | None = None

    @property
    def order(self) -> tuple[datetime, str]:
        """Place in event order."""
        return self.at, self.record_id


def copies(own: Sequence[Said]) -> frozenset[str]:
    """Records of one pump whose samples an earlier one, in event order, holds already: evidence once, whatever the name."""
    seen: set[str] = set()
    found = set()
    for said in sorted(own, key=lambda said: said.order):
        if said.samples_hash in seen:
            found.add(said.record_id)
        elif said.samples_hash is not None:
            seen.add(said.samples_hash)
    return frozenset(found)


def misdated(own: Sequence[Said], maintenance: Sequence[Maintenance]) -> frozenset[str]:
    """The first record by date where several behind it agree that it does not belong there: its recorder's clock was lost.

    They count clearly fewer flight hours than it, each more than the one before, with no overhaul in between; or it lies
    more than five years before them. One against three is clear (our choice); one against one is not.
    """
    ordered = sorted(own, key=lambda said: said.order)
    if len(ordered) <= _MOST_AGREE:
        return frozenset()
    first, following = ordered[0], ordered[1 : 1 + _MOST_AGREE]
    if following[0].at - first.at > LONGEST_SILENCE:
        return frozenset({first.record_id})
    overhauls = [m.at for m in maintenance if m.action == OVERHAUL]
    stated = [said for said in ordered[1:] if said.hours is not None][:_MOST_AGREE]
    if first.hours is None or len(stated) < _MOST_AGREE or any(first.at < at <= stated[-1].at for at in overhauls):
        return frozenset()
    fewer = all(_fewer(first, said, CLEARLY_HOURS) for said in stated)
    agree = not any(_fewer(a, b, HOURS_TOLERANCE) for a, b in pairwise(stated))
    return frozenset({first.record_id}) if fewer and agree else frozenset()


def remarks_on(
    own: Sequence[Said], elsewhere: Mapping[str, Sequence[str]], maintenance: Sequence[Maintenance]
) -> Remarks:
    """Remarks by record.

    Parameters
    ----------
    own
        Records of one pump that count.
    elsewhere
        Remarks on records that records of other pumps contradict.
    maintenance
        What was done to the pump; an overhaul counts the hours anew.
    """
    found: Remarks = {}
    lost = misdated(own, maintenance)
    in_order = sorted(own, key=lambda said: said.order)
    ordered = [said for said in in_order if said.record_id not in lost]
    for record_id, words in (
        *((record_id, MISDATED) for record_id in sorted(lost)),
        *_copies(ordered),
        *_overlaps(ordered),
        *((here.record_id, words) for here in in_order for words in elsewhere.get(here.record_id, ())),
        *hours_against_dates(ordered, [m.at for m in maintenance if m.action == OVERHAUL]),
        *_silences(ordered),
    ):
        if words not in found.setdefault(record_id, []):
            found[record_id].append(words)
    return found


def names_alike(own: Sequence[Said]) -> list[str]:
    """Aircraft and positions of a pump's records that differ and are easily taken for one another."""
    names = {"aircraft": {said.aircraft for said in own}, "positions": {said.position for said in own}}
    found = []
    for kind, different in names.items():
        looks: dict[str, list[str]] = {}
        for name in sorted(different):
            looks.setdefault(look_of(name), []).append(name)
        alike = [" and ".join(same) for same in looks.values() if len(same) > 1]
        found += [f"{kind} {same} look alike: the same one in two spellings?" for same in alike]
    return found


def overlap(a: Said, b: Said) -> bool:
    """Whether two records lie over each other in time by more than clocks differ."""
    if a.until is None or b.until is None:
        return False
    shared = min(a.until, b.until) - max(a.at, b.at)
    shorter = min(a.until - a.at, b.until - b.at)
    return shared > min(OVERLAP_TOLERANCE, shorter / 2)


def meet(a: Said, b: Said) -> bool:
    """Whether two records lie over each other in time at all."""
    return a.until is not None and b.until is not None and a.at < b.until and b.at < a.until


def hours_against_dates(ordered: Sequence[Said], overhauls: Sequence[datetime]) -> Iterator[tuple[str, str]]:
    """Records whose flight hours do not follow those of the record before, in event order."""
    for before, here in pairwise(said for said in ordered if said.hours is not None):
        if any(before.at < at <= here.at for at in overhauls):
            continue
        if _fewer(before, here, HOURS_TOLERANCE):
            yield here.record_id, HOURS_BACKWARDS
        elif _faster(before, here):
            yield here.record_id, HOURS_TOO_FAST


def contradicted(new: Said, before: Said | None, after: Said, overhauls: Sequence[datetime]) -> bool:
    """Whether a new record clearly counts more flight hours than the next one by date that states any.

    ``before`` is the last one before it. Where the stored hours fall at this place already, they were counted anew
    there, and nothing is clear.
    """
    if not _fewer(new, after, CLEARLY_HOURS) or any(new.at < at <= after.at for at in overhauls):
        return False
    if before is None or _fewer(before, new, CLEARLY_HOURS):
        return True
    return not _fewer(before, after, CLEARLY_HOURS)


def _fewer(before: Said, here: Said, tolerance: float) -> bool:
    return before.hours is not None and here.hours is not None and here.hours < before.hours - tolerance


def _faster(before: Said, here: Said) -> bool:
    elapsed = (here.at - before.at).total_seconds() / 3600.0
    return before.hours is not None and here.hours is not None and here.hours - before.hours > elapsed + CLEARLY_HOURS


def _copies(ordered: Sequence[Said]) -> Iterator[tuple[str, str]]:
    first: dict[str, Said] = {}
    for here in ordered:
        if here.samples_hash is None:
            continue
        earlier = first.setdefault(here.samples_hash, here)
        if earlier is not here:
            part = f" {earlier.segment}" if earlier.segment else ""
            yield here.record_id, f"the samples of flight {earlier.flight_id}{part} again: one flight counts once"


def _overlaps(ordered: Sequence[Said]) -> Iterator[tuple[str, str]]:
    """Flights of one pump at the same time; segments of one flight lie over each other rightly."""
    running: list[Said] = []
    for here in ordered:
        running = [said for said in running if said.until is not None and said.until > here.at]
        for said in running:
            if not overlap(said, here):
                continue
            same_place = (said.aircraft, said.position) == (here.aircraft, here.position)
            if said.flight_id == here.flight_id and same_place:
                continue
            if said.aircraft != here.aircraft:
                yield here.record_id, f"on {said.aircraft} and {here.aircraft} at the same time"
            elif said.position != here.position:
                yield here.record_id, f"at {said.position} and {here.position} of {here.aircraft} at the same time"
            else:
                yield here.record_id, "two flights at the same time"
        running.append(here)


def _silences(ordered: Sequence[Said]) -> Iterator[tuple[str, str]]:
    for before, here in pairwise(ordered):
        if here.at - before.at > LONGEST_SILENCE:
            yield here.record_id, SILENCE
