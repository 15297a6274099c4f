"""The healthy curve that holds for a pump type: measured where somebody has measured one, else the twin's."""

from collections.abc import Sequence
from datetime import datetime

from pydantic import Field
from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from detectors.expectation.type_correction import HealthyCurve, HealthyPoint
from service.bodies import Body
from service.storage.tables import ReferenceCurve


class MeasuredPoint(Body):
    """One healthy point; pressures [bar, gauge; case minus reservoir], temperature [degC], speed [rpm]."""

    discharge_pressure_bar: float = Field(ge=0.0, le=1000.0)
    case_minus_reservoir_bar: float = Field(ge=-1.0, le=50.0)
    fluid_temperature_degc: float = Field(ge=-60.0, le=200.0)
    speed_rpm: float = Field(gt=0.0, le=30_000.0)


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
    return None if row is None else judged_curve([MeasuredPoint(**point) for point in row.points["items"]])


def judged_curve(points: Sequence[MeasuredPoint]) -> HealthyCurve:
    """Measured points as the judge takes them."""
    return HealthyCurve(
        tuple(
            HealthyPoint(p.discharge_pressure_bar, p.case_minus_reservoir_bar, p.fluid_temperature_degc, p.speed_rpm)
            for p in points
        )
    )
