"""What an upload's pump and aircraft are known for while the upload is read, each asked for once."""

from collections.abc import Mapping
from dataclasses import dataclass

from service.history.analysis import RecordAnalysis, analysed
from service.history.archive import RegisteredType
from service.history.dossier import Dossier, dossier
from service.history.knowledge import setting_of, thresholds_now
from service.history.setting import Setting
from service.ingest.decode import DEFAULT_PUMP_TYPE, DecodedRecord, FullScales
from service.ingest.metadata import RecordMetadata, TypeLookup
from service.pump_types.parameter_sets import find_type, held_type
from service.storage.database import Database
from service.thresholds.layers import thresholds_of
from twin.parameters import PumpType


@dataclass(slots=True)
class Surroundings:
    """Answers for one upload of an operator, unless its file names another one."""

    database: Database
    operator: str
    _asked: tuple[str, str, str] | None = None
    _dossier: Dossier | None = None
    _setting: Setting | None = None

    @property
    def registered(self) -> RegisteredType:
        """Pump type that is registered for a serial number."""

        def registered(named: str | None, serial: str) -> str | None:
            if self._asked is not None and self._asked[:2] == (named or self.operator, serial):
                return self._dossier.pump.pump_type if self._dossier else None
            with self.database.reading() as session:
                found = dossier(session, named or self.operator, serial)
            return found.pump.pump_type if found else None

        return registered

    @property
    def types(self) -> TypeLookup:
        """Pump types by name."""

        def known(named: str | None, name: str) -> PumpType | None:
            with self.database.reading() as session:
                return find_type(session, named or self.operator, name)

        return known

    @property
    def full_scales(self) -> FullScales:
        """Full scales of the sensors that a record's aircraft has of its own."""

        def fitted(metadata: RecordMetadata) -> Mapping[str, float]:
            self._look(metadata, metadata.operator or self.operator)
            return {} if self._setting is None else {s.channel: s.full_scale_bar for s in self._setting.sensors}

        return fitted

    def dossier_of(self, metadata: RecordMetadata, operator: str) -> Dossier | None:
        """The dossier of a record's pump with its aircraft, as it was when it was first asked for."""
        self._look(metadata, operator)
        return self._dossier

    def analysed(self, decoded: DecodedRecord, operator: str) -> RecordAnalysis:
        """A record analysed as what is known now wants it; what changes meanwhile, the fold notices by the key."""
        metadata = decoded.metadata
        found = self.dossier_of(metadata, operator)
        name = found.pump.pump_type if found else (metadata.pump_type or DEFAULT_PUMP_TYPE)
        with self.database.reading() as session:
            kind = held_type(session, operator, name)
            if found is None:
                thresholds = thresholds_of(session, operator, metadata.pump_serial, name)
            else:
                thresholds = thresholds_now(session, found, name)
        return analysed(decoded.recording, kind, self._setting or Setting(), thresholds)

    def _look(self, metadata: RecordMetadata, operator: str) -> None:
        asked = (operator, metadata.pump_serial, metadata.aircraft)
        if self._asked == asked:
            return
        with self.database.reading() as session:
            found = dossier(session, *asked)
            place = metadata.aircraft, metadata.position
            self._setting = setting_of(session, operator, found, *place, metadata.started_at)
        self._asked, self._dossier = asked, found
