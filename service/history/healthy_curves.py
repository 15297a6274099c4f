"""The healthy curve that holds for a pump type: measured where somebody has measured one, else the twin's."""

import math
from collections.abc import Mapping, Sequence
from datetime import datetime

from pydantic import Field
from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from detectors.expectation.type_correction import HealthyCurve, HealthyPoint
from service.bodies import Body
from service.storage.tables import ReferenceCurve

CONDITIONS: Mapping[str, str] = {
    "discharge_pressure_bar": "discharge_pressure_bar",
    "case_minus_reservoir_bar": "case_pressure_bar",
    "fluid_temperature_degc": "fluid_temperature_degc",
    "speed_rpm": "shaft_speed_rpm",
}
"""Numbers of a point in their order, and the channel of a record that each comes from."""


class MeasuredPoint(Body):
    """One healthy point; pressures [bar, gauge; case minus reservoir], temperature [degC], speed [rpm], and how fast the fluid
    warmed meanwhile [K/min]. What the pump type declares that it lacks may be left out.
    """

    discharge_pressure_bar: float | None = Field(default=None, ge=0.0, le=1000.0)
    case_minus_reservoir_bar: float | None = Field(default=None, ge=-1.0, le=50.0)
    fluid_temperature_degc: float | None = Field(default=None, ge=-60.0, le=200.0)
    speed_rpm: float | None = Field(default=None, gt=0.0, le=30_000.0)
    warming_k_per_min: float = Field(default=0.0, ge=-100.0, le=100.0)


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
    """Measured points as the judge takes them: not-a-number where the type lacks the channel."""

    def known(value: float | None) -> float:
        return math.nan if value is None else value

    return HealthyCurve(
        tuple(
            HealthyPoint(
                known(p.discharge_pressure_bar),
                known(p.case_minus_reservoir_bar),
                known(p.fluid_temperature_degc),
                known(p.speed_rpm),
                p.warming_k_per_min,
            )
            for p in points
        )
    )
