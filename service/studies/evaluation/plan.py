"""What a study runs: rows, pumps, seed; and the chunks that it is worked off in."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from detectors.evaluation.reality import REALITIES, Reality
from detectors.evaluation.rows import BURST, ROWS, Row
from detectors.evaluation.strange import STRANGE_ROWS
from detectors.evaluation.study import chunks
from detectors.words.thresholds import effective

_MARGIN = 1.01
"""Flights drop out by chance: a little more than the mean makes sure of the wanted records."""


class StudyFaultsError(Exception):
    """What is wrong with a study that was asked for: every fault."""

    def __init__(self, faults: Sequence[str]) -> None:
        super().__init__("; ".join(faults))
        self.faults = tuple(faults)


@dataclass(frozen=True, slots=True)
class Study:
    """A study: ``n_pumps`` in each row, spread over the realities; healthy rows by records in each reality."""

    rows: tuple[Row, ...]
    n_pumps: int = 300
    n_healthy_records: int = 100_000
    seed: int = 1
    pump_type: str = "h225"
    circuit: str = "shared_return"


@dataclass(frozen=True, slots=True)
class Chunk:
    """One task: some pumps of a row in a reality; plain data that can be sent to another process."""

    row: Row
    reality: Reality
    number: int
    n_pumps: int
    seed: int
    pump_type: str
    circuit: str


def chosen_rows(names: Iterable[str]) -> tuple[Row, ...]:
    """Rows by name, without ``; burst`` both of them; all without a name.

    Raises
    ------
    StudyFaultsError
        naming every unknown name and what there is.
    """
    wanted = list(names)
    rows = (*ROWS, *STRANGE_ROWS)
    known = [r.name for r in rows]
    unknown = [name for name in wanted if name not in known]
    if unknown:
        faults = [f"no row {name!r}" for name in unknown]
        raise StudyFaultsError([*faults, "rows: " + "; ".join(n for n in known if not n.endswith(BURST))])
    return tuple(r for r in rows if not wanted or r.name in wanted or r.name.removesuffix(BURST) in wanted)


def sized(
    rows: Iterable[str], n_pumps: int | None, n_healthy_records: int | None, seed: int, *, quick: bool = False
) -> Study:
    """Study of the full size, or of a minute's; a number that is given wins.

    Raises
    ------
    StudyFaultsError
        naming every unknown row.
    """
    pumps, records = (8, 1000) if quick else (300, 100_000)
    return Study(chosen_rows(rows), n_pumps or pumps, n_healthy_records or records, seed)


def pumps_in(row: Row, study: Study) -> dict[Reality, int]:
    """Pumps of a row in each reality; realities that get none are left out."""
    if row.by_records:
        judged = row.n_flights * (1.0 - row.sensing.dropout) - effective({})["baseline_records"]
        n = math.ceil(_MARGIN * study.n_healthy_records / judged)
        return dict.fromkeys(REALITIES, n)
    share, rest = divmod(study.n_pumps, len(REALITIES))
    counts = {reality: share + (k < rest) for k, reality in enumerate(REALITIES)}
    return {reality: n for reality, n in counts.items() if n}


def chunks_of(row: Row, study: Study) -> list[Chunk]:
    """Every chunk of a row."""
    return [
        Chunk(row, reality, number, n, study.seed, study.pump_type, study.circuit)
        for reality, n_pumps in pumps_in(row, study).items()
        for number, n in chunks(n_pumps)
    ]
