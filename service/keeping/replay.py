"""A bundle replayed: its records are reduced and folded anew from their raw bytes, and the verdicts are compared."""

import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, cast

from sqlalchemy import select, update

from service.answers.documents import JsonObject
from service.identity import software
from service.keeping.bundle import EXPECTED
from service.keeping.container import read
from service.keeping.manifest import BundleManifest, faults_of_files, raw_files, raw_name, read_bundle
from service.keeping.restore import fill_sqlite
from service.monitoring.reanalysis import reprocessed
from service.reading import queries
from service.reading.forecast import with_crossing
from service.running import opened
from service.settings import Settings
from service.storage.database import upgrade
from service.storage.tables import Pump

if TYPE_CHECKING:
    from service.answers import verdicts as answers

_NO_PART = "software"
"""Who made a verdict is no part of two being equal."""
_MOST_DIFFERENCES = 50


class Difference(TypedDict):
    """A place in two verdicts, ``estimates.case_flow_at_reference_lpm.mean``, and what stands there."""

    where: str
    expected: object
    found: object


class Replayed(TypedDict):
    """A replay as JSON: the first differences only."""

    identical: bool
    pump: str
    operator: str
    issued_by: "answers.Software | None"
    replayed_by: "answers.Software"
    explanation: str | None
    differences: list[Difference]
    expected: "answers.Verdict"
    verdict: "answers.Verdict"


@dataclass(frozen=True, slots=True)
class Replay:
    """What a replay gave: both verdicts, who issued the one and who made the other, and where they differ."""

    manifest: BundleManifest
    expected: "answers.Verdict"
    verdict: "answers.Verdict"
    differences: list[Difference]

    @property
    def is_identical(self) -> bool:
        """True where the verdicts agree to the last digit."""
        return not self.differences

    def explanation(self) -> str | None:
        """What may explain a difference: another release, other sources; None where the same code has made both."""
        issued, ours = self.manifest["issued_by"], software().to_json()
        if issued is None:
            return "the verdict does not say which release issued it"
        if issued["sources"] == ours["sources"] and issued["release"] == ours["release"]:
            return None
        commit = f", commit {issued['commit']}" if issued["commit"] else ""
        return (
            f"issued by release {issued['release']}{commit}, sources {issued['sources']}; replayed by release "
            f"{ours['release']}, sources {ours['sources']}: replay it with the image of the release that issued it"
        )

    def to_json(self) -> Replayed:
        """As the command line says it."""
        return {
            "identical": self.is_identical,
            "pump": self.manifest["pump"],
            "operator": self.manifest["operator"],
            "issued_by": self.manifest["issued_by"],
            "replayed_by": software().to_json(),
            "explanation": self.explanation(),
            "differences": self.differences[:_MOST_DIFFERENCES],
            "expected": self.expected,
            "verdict": self.verdict,
        }


def replay(place: Path) -> Replay:
    """Replay a bundle in an installation of its own that is gone afterwards.

    Raises
    ------
    ValueError
        when it is no bundle or not whole.
    Problem
        when a record cannot be read any more.
    """
    with read(place) as source, tempfile.TemporaryDirectory(prefix="casedrain-replay-") as folder:
        manifest = read_bundle(source)
        faults = faults_of_files(source, manifest)
        if faults:
            raise ValueError(f"the bundle is not whole: {'; '.join(faults[:5])}")
        with source.open(EXPECTED) as file:
            expected = cast("answers.Verdict", json.loads(file.read()))
        database, raw = Path(folder) / "casedrain.sqlite", Path(folder) / "raw"
        fill_sqlite(source, manifest, database)
        upgrade(f"sqlite:///{database}")
        settings = Settings(
            database_url=f"sqlite:///{database}", data_dir=Path(folder), raw_store_url=str(raw), audit_key=""
        )
        context = opened(settings)
        try:
            for digest, _ in raw_files(source):
                with source.open(raw_name(digest)) as file:
                    context.raw_store.put(file.read())
            with context.database.writing() as session:
                # a newer release may have held the pump: here it is nobody's
                session.execute(update(Pump).values(made_by=None, made_with=None))
                pumps = list(session.scalars(select(Pump.id).order_by(Pump.id)))
            for pump_id in pumps:
                reprocessed(context.database, context.archive, pump_id, reduce_anew=True)
            with context.database.reading() as session:
                pump = session.get_one(Pump, manifest["pump_id"])
                verdict = with_crossing(session, pump, queries.verdict(session, pump))
        finally:
            context.close()
    found = cast("answers.Verdict", json.loads(json.dumps(verdict)))
    return Replay(manifest, expected, found, list(differences(_equal_part(expected), _equal_part(found))))


def differences(expected: object, found: object, where: str = "") -> Iterator[Difference]:
    """Where two JSON values differ: the path, what was expected and what was found."""
    if isinstance(expected, dict) and isinstance(found, dict):
        for name in sorted(expected.keys() | found.keys()):
            yield from differences(expected.get(name), found.get(name), f"{where}.{name}" if where else name)
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        for i, (one, other) in enumerate(zip(expected, found, strict=True)):
            yield from differences(one, other, f"{where}[{i}]")
    elif expected != found:
        yield {"where": where, "expected": expected, "found": found}


def _equal_part(verdict: "answers.Verdict") -> JsonObject:
    return {name: value for name, value in verdict.items() if name != _NO_PART}
