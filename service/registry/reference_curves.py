"""Healthy points measured on an iron bird or a test bench, in place of the twin's reference curve."""

from datetime import UTC, datetime

from pydantic import ConfigDict, Field
from sqlalchemy.orm import Session

from detectors.expectation.type_correction import followed
from service.answers import registry as answers
from service.answers.words import instant
from service.bodies import Body
from service.errors import Fault, Invalid
from service.history.healthy_curves import CONDITIONS, MeasuredPoint, judged_curve
from service.history.setting import DEFAULT_CIRCUIT
from service.pump_types.parameter_sets import held_type
from service.storage.tables import ReferenceCurve
from twin.parameters import PumpType
from twin.pumps import circuit_parameters


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


def put(session: Session, operator: str | None, pump_type: str, body: NewReferenceCurve, author: str) -> ReferenceCurve:
    """Store measured points, for one operator or for all; earlier ones stay readable at their time.

    Raises
    ------
    Invalid
        naming every number that a point lacks and the type does not, and every point at whose speed and temperature the
        twin has no solution to compare it with.
    """
    kind = held_type(session, operator, pump_type)
    missing = [
        Fault(f"body.points.{i}.{name}", "is missing, and the pump type does not say that its records lack it")
        for i, point in enumerate(body.points)
        for name, channel in CONDITIONS.items()
        if getattr(point, name) is None and channel not in kind.lacks
    ]
    if missing:
        raise Invalid(f"the curve lacks {len(missing)} number(s); nothing was stored", missing)
    faults = _not_followed(body, kind)
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


def _not_followed(body: NewReferenceCurve, kind: PumpType) -> list[Fault]:
    """Points that the twin has no solution for; none of a type that is judged without one."""
    if not kind.own_twin or {"shaft_speed_rpm", "fluid_temperature_degc"}.intersection(kind.lacks):
        return []
    solved = followed(judged_curve(body.points), kind, circuit_parameters(DEFAULT_CIRCUIT))
    return [
        Fault(
            f"body.points.{i}", f"the twin has no solution at {p.speed_rpm:g} rpm and {p.fluid_temperature_degc:g} degC"
        )
        for i, (p, good) in enumerate(zip(body.points, solved, strict=True))
        if not good
    ]


def document(pump_type: str, row: ReferenceCurve | None) -> answers.ReferenceCurve:
    """A reference curve in the shape of the API; without measured points the twin's own holds."""
    if row is None:
        return {"pump_type": pump_type, "source": "twin", "operator": None, "points": [], "recorded_at": None}
    return {
        "pump_type": pump_type,
        "source": "measured",
        "operator": row.operator,
        "points": row.points["items"],
        "recorded_at": instant(row.recorded_at),
        "author": row.author,
    }
