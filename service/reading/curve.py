"""Damage identification curve of a stored pump, as the API shows it."""

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.orm import Session

from detectors.curve.points import AXES, Curve, damage_identification_curve, latest_condition
from detectors.words.observation import History, Maintenance
from service.answers.pumps import CurveResiduals, DamageIdentificationCurve
from service.answers.words import instant
from service.history.analysis import observation_of
from service.history.dossier import dossier
from service.history.healthy_curves import healthy_curve
from service.history.knowledge import counting_records, entries, installation_intervals, setting_of
from service.history.known import ALONE, Others
from service.history.placement import changes, place_at
from service.history.setting import Setting
from service.pump_types.parameter_sets import held_type
from service.storage.tables import MaintenanceEvent, Pump, Record
from service.thresholds.layers import thresholds_of


@dataclass(frozen=True, slots=True)
class FoundCurve:
    """The curve and its JSON document."""

    curve: Curve
    document: DamageIdentificationCurve


def curve_of(
    session: Session,
    pump: Pump,
    at: datetime | None,
    speed_rpm: float | None,
    fluid_temperature_degc: float | None,
    others: Others = ALONE,
) -> FoundCurve:
    """Curve of a pump from its records up to ``at``, brought to the chosen or the latest condition.

    ``others`` is what its records take over from other pumps (``service.monitoring.succession``).

    The history is folded as it is stored: what an older release has reduced is not read again for a picture.
    """
    rows = [row for row in counting_records(session, pump.id) if at is None or _start(row) <= at]
    intervals = installation_intervals(session, pump.id)
    observations = [
        observation_of(
            row, place_at(intervals, row.aircraft or "", row.position or "", _start(row)), row.reduction or {}
        )
        for row in rows
    ]
    setting = Setting()
    if rows:
        last = rows[-1]
        place = (last.aircraft or "", last.position or "")
        setting = setting_of(session, pump.operator, dossier(session, pump.operator, pump.serial), *place, _start(last))
    base = held_type(session, pump.operator, pump.pump_type)
    kind = setting.pump_type(base)
    condition = latest_condition(observations, kind)
    if speed_rpm is not None:
        condition = condition._replace(speed_rpm=speed_rpm)
    if fluid_temperature_degc is not None:
        condition = condition._replace(fluid_temperature_degc=fluid_temperature_degc)
    thresholds = thresholds_of(session, pump.operator, pump.serial, pump.pump_type)
    maintenance = tuple(
        Maintenance(e.at, e.action, e.fluid, e.channel) for e in entries(session, MaintenanceEvent, pump.id)
    )
    measured = healthy_curve(session, pump.operator, pump.pump_type) if setting.has_own_fluid(base) else None
    history = History(tuple(observations), maintenance, changes(intervals))
    curve = damage_identification_curve(
        history, kind, setting.circuit_parameters, thresholds.values, condition, measured, others
    )
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
            {
                "x": p.x,
                "y": p.y,
                "low": p.low,
                "high": p.high,
                "system_leakage_lpm": p.system_leakage_lpm,
                "covariance": [list(row) for row in p.covariance],
            }
            for p in curve.curve
        ],
        "points": [
            {"at": instant(p.at), "x": p.x, "y": p.y, "covariance": [list(row) for row in p.covariance]}
            for p in curve.points
        ],
        "directions": {
            name: {"dx": d.dx, "dy": d.dy, "per": d.per, "both_ways": d.both_ways}
            for name, d in curve.directions.items()
        },
        "readings": [{"at": instant(r.at), "x": r.x, "y": r.y, "y_first_zero": r.y_first_zero} for r in curve.readings],
        "measured_curve": [{"x": x, "y": y} for x, y in curve.measured],
        "residuals_by_temperature": _residuals(curve),
    }


def _residuals(curve: Curve) -> CurveResiduals:
    return {
        "points": [
            {
                "at": instant(e.at),
                "fluid_temperature_degc": e.fluid_temperature_degc,
                "residual": e.residual,
                "standard_deviation": e.standard_deviation,
                "fitted": e.fitted,
            }
            for e in curve.excess
        ],
        "laws": {
            name: {
                "size": law.size,
                "unit": law.unit,
                "misfit": law.misfit,
                "curve": [{"fluid_temperature_degc": t, "residual": v} for t, v in law.curve],
            }
            for name, law in (curve.laws or {}).items()
        },
    }
