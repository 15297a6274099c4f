"""Damage identification curve of a stored pump, as the API shows it."""

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.orm import Session

from detectors.curve.points import AXES, Curve, damage_identification_curve, latest_condition
from service.answers.pumps import DamageIdentificationCurve
from service.answers.words import instant
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
    document: DamageIdentificationCurve


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


def curve_document(curve: Curve) -> DamageIdentificationCurve:
    """Curve in the shape of the API."""
    baseline, conditions = curve.baseline, curve.conditions
    return {
        "axes": {"x": AXES["x"], "y": AXES["y"]},
        "conditions": {
            "speed_rpm": conditions["speed_rpm"],
            "fluid_temperature_degc": conditions["fluid_temperature_degc"],
            "reservoir_pressure_bar": conditions["reservoir_pressure_bar"],
        },
        "baseline": {"dx": baseline.dx, "dy": baseline.dy, "records": baseline.records},
        "curve": [
            {"x": p.x, "y": p.y, "low": p.low, "high": p.high, "system_leakage_lpm": p.system_leakage_lpm}
            for p in curve.curve
        ],
        "points": [
            {"at": instant(p.at), "x": p.x, "y": p.y, "covariance": [list(row) for row in p.covariance]}
            for p in curve.points
        ],
        "directions": {name: {"dx": d.dx, "dy": d.dy, "per": d.per} for name, d in curve.directions.items()},
    }
