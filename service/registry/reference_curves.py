"""Healthy points measured on an iron bird or a test bench, in place of the twin's reference curve."""

from datetime import UTC, datetime
from typing import Any

from pydantic import ConfigDict, Field
from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from service.registry.fields import Body
from service.tables import ReferenceCurve


class MeasuredPoint(Body):
    """One healthy point; pressures [bar, gauge; case minus reservoir], temperature [degC], speed [rpm]."""

    discharge_pressure_bar: float = Field(ge=0.0, le=1000.0)
    case_minus_reservoir_bar: float = Field(ge=-1.0, le=50.0)
    fluid_temperature_degc: float = Field(ge=-60.0, le=200.0)
    speed_rpm: float = Field(gt=0.0, le=30_000.0)


class NewReferenceCurve(Body):
    """Measured points of a pump type; they replace those stored before."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "points": [
                        {
                            "discharge_pressure_bar": pressure,
                            "case_minus_reservoir_bar": rise,
                            "fluid_temperature_degc": 50.0,
                            "speed_rpm": 4600.0,
                        }
                        for pressure, rise in ((174.0, 0.35), (170.0, 0.39))
                    ]
                }
            ]
        }
    )
    points: list[MeasuredPoint] = Field(min_length=2, max_length=10_000)


def reference_curve(
    session: Session, operator: str | None, pump_type: str, known_at: datetime | None = None
) -> ReferenceCurve | None:
    """The measured curve that holds for an operator's pumps of a type: its own, else everybody's; None without one."""
    own_or_all = or_(ReferenceCurve.operator.is_(None), ReferenceCurve.operator == operator)
    query = select(ReferenceCurve).where(ReferenceCurve.pump_type == pump_type, own_or_all)
    if known_at is not None:
        query = query.where(ReferenceCurve.recorded_at <= known_at)
    query = query.order_by(ReferenceCurve.operator.is_(None), ReferenceCurve.id.desc())
    return session.scalar(query.limit(1))


def reference_points(
    session: Session, operator: str | None, pump_type: str, known_at: datetime | None = None
) -> list[MeasuredPoint]:
    """Points of the measured curve that holds; empty where the twin's own curve does."""
    row = reference_curve(session, operator, pump_type, known_at)
    return [] if row is None else [MeasuredPoint(**point) for point in row.points["items"]]


def put(session: Session, operator: str | None, pump_type: str, body: NewReferenceCurve, author: str) -> ReferenceCurve:
    """Store measured points, for one operator or for all; earlier ones stay readable at their time."""
    row = ReferenceCurve(
        pump_type=pump_type,
        operator=operator,
        points={"items": [point.model_dump() for point in body.points]},
        recorded_at=datetime.now(UTC),
        author=author,
    )
    session.add(row)
    session.flush()
    return row


def document(pump_type: str, row: ReferenceCurve | None) -> dict[str, Any]:
    """A reference curve in the shape of the API; without measured points the twin's own holds."""
    if row is None:
        return {"pump_type": pump_type, "source": "twin", "operator": None, "points": [], "recorded_at": None}
    return {
        "pump_type": pump_type,
        "source": "measured",
        "operator": row.operator,
        "points": row.points["items"],
        "recorded_at": row.recorded_at,
        "author": row.author,
    }
