"""Damage identification curve of a stored pump, as the API shows it."""

from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from sqlalchemy.orm import Session

from detectors.curve.points import AXES, Curve, damage_identification_curve, latest_condition
from service.history.analysis import observation_of
from service.history.knowledge import counting_records, setting_of
from service.history.placement import Place
from service.history.setting import Setting
from service.pump_types.parameter_sets import held_type
from service.storage.tables import Pump, Record


@dataclass(frozen=True, slots=True)
class FoundCurve:
    """The curve and its JSON document."""

    curve: Curve
    document: dict[str, Any]


def curve_of(
    session: Session, pump: Pump, at: datetime | None, speed_rpm: float | None, fluid_temperature_degc: float | None
) -> FoundCurve:
    """Curve of a pump from its records up to ``at``, brought to the chosen or the latest condition."""
    rows = [row for row in counting_records(session, pump.id) if at is None or _start(row) <= at]
    observations = [
        observation_of(row, Place(row.aircraft or "", row.position or ""), row.reduction or {}) for row in rows
    ]
    setting = Setting()
    if rows:
        last = rows[-1]
        place = (last.aircraft or "", last.position or "")
        setting = setting_of(session, pump.operator, pump.serial, *place, _start(last))
    kind = setting.pump_type(held_type(session, pump.operator, pump.pump_type))
    condition = latest_condition(observations, kind)
    if speed_rpm is not None:
        condition = condition._replace(speed_rpm=speed_rpm)
    if fluid_temperature_degc is not None:
        condition = condition._replace(fluid_temperature_degc=fluid_temperature_degc)
    curve = damage_identification_curve(observations, kind, setting.circuit_parameters, condition)
    return FoundCurve(curve, curve_document(curve))


def _start(row: Record) -> datetime:
    if row.started_at is None:
        raise RuntimeError(f"record {row.id} counts without a start")
    return row.started_at


def curve_document(curve: Curve) -> dict[str, Any]:
    """Curve in the shape of the API."""
    return {
        "axes": dict(AXES),
        "conditions": dict(curve.conditions),
        "baseline": asdict(curve.baseline),
        "curve": [asdict(point) for point in curve.curve],
        "points": [asdict(point) for point in curve.points],
        "directions": {name: asdict(direction) for name, direction in curve.directions.items()},
    }
