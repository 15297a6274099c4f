"""Damage identification curve of a stored pump, as the API shows it and as PNG."""

import io
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from matplotlib.figure import Figure
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


def curve_png(curve: Curve, title: str) -> bytes:
    """Curve as a PNG picture."""
    figure = Figure(figsize=(8.2, 5.2), layout="constrained")
    axes = figure.add_subplot()
    xs = [p.x for p in curve.curve]
    axes.fill_between(
        xs, [p.low for p in curve.curve], [p.high for p in curve.curve], color="#cfe0f1", label="90 % of healthy pumps"
    )
    axes.plot(xs, [p.y for p in curve.curve], color="#1f5f99", label="healthy pump, growing demand")
    if curve.points:
        axes.scatter(
            [p.x for p in curve.points],
            [p.y for p in curve.points],
            facecolors="none",
            edgecolors="#5a6675",
            label="records",
        )
        axes.scatter(curve.points[-1].x, curve.points[-1].y, color="#1b2430", zorder=3, label="latest")
    axes.set(xlabel="discharge pressure [bar]", ylabel="case minus reservoir pressure [bar]", title=title)
    axes.grid(color="#e1e6ec")
    axes.legend(frameon=False)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110)
    return out.getvalue()
