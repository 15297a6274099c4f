"""Table 2-7: the 24 effects of eight published compensator models, and which numbers of the pump hold each of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from twin.laws.metering_edge import MARE
from twin.parameters import Pump


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect of table 2-7.

    Attributes
    ----------
    body, name
        Row of the table.
    off, on
        ``"part.field"`` of the pump to values [SI] without the effect (or with next to none of it) and with it.
    healthy
        True where the h225 set has it in; False where its numbers leave it out.
    note
        Law behind it, and what it leaves out.
    """

    body: str
    name: str
    off: Mapping[str, float]
    on: Mapping[str, float]
    healthy: bool
    note: str = field(default="")


def with_fields(pump: Pump, fields: Mapping[str, float]) -> Pump:
    """Copy of a pump with the given ``"part.field"`` numbers."""
    parts: dict[str, Any] = {}
    for name, value in fields.items():
        part, _, entry = name.partition(".")
        block = parts.get(part, getattr(pump, part))
        parts[part] = block._replace(**{entry: value})
    return pump._replace(**parts)


_SPOOL, _PLATE, _STROKE, _RATE = "spool", "swashplate", "stroking piston", "compensating piston"
# a fed bore takes over most of the rate spring's force
_FED = {"servo.rate_fed": 1.0, "servo.F_rate": 0.0}

TABLE_2_7: tuple[Effect, ...] = (
    Effect(_SPOOL, "inertia", {"compensator.m_spool": 1.0e-4}, {"compensator.m_spool": 1.0e-2}, True),
    Effect(_SPOOL, "annular leakage", {"compensator.c_spool": 0.0}, {"compensator.c_spool": 6.0e-6}, True, "(2-9)"),
    Effect(
        _SPOOL,
        "annular leakage: eccentricity",
        {"compensator.e_rel": 0.0},
        {"compensator.e_rel": 1.0},
        False,
        "(2-9): 2.5 times the leakage when the spool touches its sleeve",
    ),
    Effect(
        _SPOOL,
        "friction",
        {"compensator.damping": 1.0, "compensator.F_coulomb": 0.0},
        {"compensator.damping": 20.0, "compensator.F_coulomb": 5.0},
        True,
        "viscous; Coulomb friction (2-25) is in the model and 0 in the healthy set",
    ),
    Effect(
        _SPOOL,
        "static friction",
        {"compensator.F_coulomb": 5.0, "compensator.F_static": 5.0},
        {"compensator.F_coulomb": 5.0, "compensator.F_static": 10.0},
        False,
        "fades with speed as Stribeck's; at rest it creeps below the threshold speed instead of sticking",
    ),
    Effect(_SPOOL, "steady jet force", {"compensator.cos_jet": 0.0}, {"compensator.cos_jet": 0.358}, True, "(2-21)"),
    Effect(
        _SPOOL,
        "transient jet force",
        {"compensator.L_jet": 0.0},
        {"compensator.L_jet": 5.0e-3},
        False,
        "damping term of (2-22); its pressure-rate term is left out, as Merritt advises",
    ),
    Effect(
        _SPOOL,
        "turbulent orifice flow",
        {"compensator.edge_law": float(MARE), "compensator.delta_lambda": 5.0e-5},
        {"compensator.edge_law": float(MARE), "compensator.delta_lambda": 7.0e-4},
        True,
        "every edge law has it; off here means that Mare's law stays laminar to a flow number of 14 000",
    ),
    Effect(_PLATE, "inertia", {"swashplate.J": 2.5e-5}, {"swashplate.J": 2.5e-4}, True),
    Effect(
        _PLATE,
        "friction",
        {"swashplate.damping": 0.05, "swashplate.T_coulomb": 0.0},
        {"swashplate.damping": 0.5, "swashplate.T_coulomb": 0.5},
        True,
        "viscous; Coulomb friction is in the model and 0 in the healthy set",
    ),
    Effect(
        _PLATE,
        "static friction",
        {"swashplate.T_coulomb": 0.5, "swashplate.T_static": 0.5},
        {"swashplate.T_coulomb": 0.5, "swashplate.T_static": 1.0},
        False,
    ),
    Effect(_STROKE, "inertia", {"servo.m_stroke": 0.0}, {"servo.m_stroke": 0.02}, True),
    Effect(_STROKE, "annular leakage", {"servo.b_stroke": 1.0e-6}, {"servo.b_stroke": 8.0e-6}, True, "(2-9)"),
    Effect(
        _STROKE,
        "annular leakage: eccentricity",
        {"servo.e_rel_stroke": 0.0},
        {"servo.e_rel_stroke": 0.9},
        False,
        "(2-9) and, for the drag, (2-11)",
    ),
    Effect(
        _STROKE,
        "friction",
        {"servo.viscous": 0.0, "servo.F_coulomb_stroke": 0.0},
        {"servo.viscous": 1.0, "servo.F_coulomb_stroke": 10.0},
        True,
        "viscous drag of the gap (2-11); Coulomb friction is in the model and 0 in the healthy set",
    ),
    Effect(
        _STROKE,
        "static friction",
        {"servo.F_coulomb_stroke": 10.0, "servo.F_static_stroke": 10.0},
        {"servo.F_coulomb_stroke": 10.0, "servo.F_static_stroke": 20.0},
        False,
    ),
    Effect(
        _STROKE,
        "sporadic contact with the swashplate",
        {"servo.contact": 0.0},
        {"servo.contact": 1.0},
        False,
        "(2-14); one switch sets both pistons free",
    ),
    Effect(_RATE, "inertia", {"servo.m_rate": 0.0}, {"servo.m_rate": 0.02}, True),
    Effect(
        _RATE,
        "annular leakage",
        {**_FED, "servo.b_rate": 1.0e-6},
        {**_FED, "servo.b_rate": 8.0e-6},
        False,
        "(2-9); only where its bore is fed from discharge: the h225's is vented, the same pressure on both sides",
    ),
    Effect(
        _RATE,
        "annular leakage: eccentricity",
        {**_FED, "servo.e_rel_rate": 0.0},
        {**_FED, "servo.e_rel_rate": 0.9},
        False,
        "(2-9) and, for the drag, (2-11); needs a fed bore as well",
    ),
    Effect(
        _RATE,
        "friction",
        {"servo.viscous": 0.0, "servo.F_coulomb_rate": 0.0},
        {"servo.viscous": 1.0, "servo.F_coulomb_rate": 10.0},
        True,
        "as the stroking piston's; one factor scales the drag of both",
    ),
    Effect(
        _RATE,
        "static friction",
        {"servo.F_coulomb_rate": 10.0, "servo.F_static_rate": 10.0},
        {"servo.F_coulomb_rate": 10.0, "servo.F_static_rate": 20.0},
        False,
    ),
    Effect(
        _RATE,
        "sporadic contact with the swashplate",
        {"servo.contact": 0.0},
        {"servo.contact": 1.0, "servo.k_contact": 1.0e7},
        False,
        "(2-14); one switch sets both pistons free",
    ),
    Effect(
        "fluid",
        "compressibility",
        {"fluid.B_ref": 1.33e10, "fluid.air": 0.0},
        {"fluid.B_ref": 1.33e9, "fluid.air": 0.005},
        True,
        "tangent modulus by temperature and pressure with free air; off here means ten times as stiff and no air",
    ),
)
