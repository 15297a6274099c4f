"""Services that begin with uploaded flights: each history is uploaded once a session and every test gets a copy."""

import itertools
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from service.demo.fleet import DemoRecord
from service.settings import Settings
from tests.postgres import create_database
from tests.service.lent_application import lent

_numbers = itertools.count(1)


class KeptHistories:
    """Databases with their raw bytes by kind of database and history; nobody is connected to them, so they are copied.

    ``new_settings`` gives settings of a service on a fresh database of a kind, ``cluster`` the URL pattern of the
    Postgres cluster, which is asked for when it is needed.
    """

    def __init__(self, new_settings: Callable[[str], Settings], cluster: Callable[[], str]) -> None:
        self._new_settings = new_settings
        self._cluster = cluster
        self._kept: dict[tuple[str, str, int], Settings] = {}

    def copied(self, kind: str, records: Sequence[DemoRecord], folder: Path) -> Settings:
        """Settings of a service of its own, below ``folder``, to which ``records`` have been uploaded in their order."""
        key = (kind, records[0].pump.serial, len(records))
        if key not in self._kept:
            self._kept[key] = self._uploaded(kind, records)
        kept = self._kept[key]
        data = folder / "data"
        shutil.copytree(kept.data_dir, data)
        if kind == "sqlite":
            file = folder / "history.sqlite"
            shutil.copyfile(Path(kept.database_url.removeprefix("sqlite:///")), file)
            url = f"sqlite:///{file}"
        else:
            template = kept.database_url.partition("?")[0].rpartition("/")[2]
            url = create_database(self._cluster(), f"history{next(_numbers)}", template)
        return Settings(**{**kept.model_dump(), "database_url": url, "data_dir": data})

    def _uploaded(self, kind: str, records: Sequence[DemoRecord]) -> Settings:
        settings = self._new_settings(kind)
        with lent(settings) as client:
            for record in records:
                answer = client.post("/api/v1/records", content=record.content, headers={"content-type": "text/csv"})
                assert answer.status_code == 201, answer.text
        return settings
