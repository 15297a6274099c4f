"""Healthy points measured on an iron bird or a test bench, in place of the twin's reference curve."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from pydantic import ConfigDict, Field
from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from detectors.type_correction import HealthyCurve, HealthyPoint, followed
from service.bodies import Body
from service.errors import Fault, Invalid
from service.monitoring.setting import DEFAULT_CIRCUIT
from service.parameter_sets import held_type
from service.tables import ReferenceCurve
from twin.pumps import circuit_parameters


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


def healthy_curve(
    session: Session, operator: str | None, pump_type: str, known_at: datetime | None = None
) -> HealthyCurve | None:
    """The measured curve that holds, as the judge takes it; None where the twin's own does."""
    row = reference_curve(session, operator, pump_type, known_at)
    return None if row is None else _judged([MeasuredPoint(**point) for point in row.points["items"]])


def put(session: Session, operator: str | None, pump_type: str, body: NewReferenceCurve, author: str) -> ReferenceCurve:
    """Store measured points, for one operator or for all; earlier ones stay readable at their time.

    Raises
    ------
    Invalid
        naming every point at whose speed and temperature the twin has no solution to compare it with.
    """
    solved = followed(
        _judged(body.points), held_type(session, operator, pump_type), circuit_parameters(DEFAULT_CIRCUIT)
    )
    faults = [
        Fault(
            f"body.points.{i}", f"the twin has no solution at {p.speed_rpm:g} rpm and {p.fluid_temperature_degc:g} degC"
        )
        for i, (p, good) in enumerate(zip(body.points, solved, strict=True))
        if not good
    ]
    if faults:
        raise Invalid(f"{len(faults)} point(s) cannot be compared with the twin; nothing was stored", faults)
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


def _judged(points: Sequence[MeasuredPoint]) -> HealthyCurve:
    return HealthyCurve(
        tuple(
            HealthyPoint(p.discharge_pressure_bar, p.case_minus_reservoir_bar, p.fluid_temperature_degc, p.speed_rpm)
            for p in points
        )
    )


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
