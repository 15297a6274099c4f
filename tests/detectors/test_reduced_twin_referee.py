"""The compiled reduced twin against its equations written plainly; slopes by the complex step, exact to rounding.

Complex step: Im f(x + ih) / h has no cancellation, so that h = 1e-30 gives slopes to the last digits (Squire and Trapp
1998, Using complex variables to estimate derivatives of real functions).
"""

import numpy as np
import pytest

from detectors.expectation import components as c
from detectors.expectation.anchor import COLUMN, anchors
from detectors.expectation.reduced_twin import pressures
from twin.condition import Condition
from twin.pumps import circuit_parameters, pump_type

PUMP = pump_type("h225")
STEP = 1e-30
SPREAD = {
    **dict.fromkeys(("ln_slipper", "ln_laminar", "ln_drain", "softening", "ln_ripple", "ln_case_ripple"), 0.3),
    **dict.fromkeys(("throttled", "bleed", "slipper_extra", "laminar_extra", "case_offset", "once"), 0.2),
    **dict.fromkeys(("system_orifice", "system_laminar", "setting"), 1.0),
    **dict.fromkeys(("drain_viscosity", "drain_flow"), 0.5),
    **dict.fromkeys(("drain_extra", "drain_viscous", "drain_orifice"), 0.7),  # a drain up to four times as resistant
    **dict.fromkeys(("load_case", "load_case_square", "load_warmth", "load_discharge", "load_discharge_square"), 0.2),
    "ln_droop": 0.7,
    "case_warmth": 0.02,
    "ln_viscosity": 0.05,
    "reservoir": 0.3,
    "case_span": 0.3,
    "case_ripple_warmth": 0.02,
    "answer": 0.2,
}
"""One sigma of random states, wider than any pump's: every branch of the laws is met."""


def at_least(value: complex, floor: complex) -> complex:
    return value if value.real > floor.real else floor


def size(value: complex) -> complex:
    return value if value.real >= 0.0 else -value


def drain_weight(own: complex) -> complex:
    """Itself, and from zero downwards a decay to -0.1: a drain cannot push."""
    return own if own.real >= 0.0 else 0.1 * (np.exp(own / 0.1) - 1.0)


def return_line(Q: complex, k: float, K: float, gamma: float) -> complex:
    """Equation 3-4: k Q |Q|^gamma / tanh(|Q|^gamma / K), whose limit without flow is k K Q."""
    if Q == 0.0:
        return 0.0j
    return k * Q * size(Q) ** gamma / np.tanh(size(Q) ** gamma / K)


def plain(a: dict[str, float], x: dict[str, complex]) -> tuple[tuple[complex, complex, complex], bool]:
    """Discharge pressure, case pressure [bar] and case flow [L/min] of the state ``x`` around the anchor ``a``.

    And whether a bound holds one of them: there the kernel's slopes go on as if there were none.
    """
    thinner = np.exp(-x["ln_viscosity"])
    # leakages at the anchor's pressure difference: a tenth of a slipper's resistance is a throttle
    slippers = a["slipper_flow"] * np.exp(x["ln_slipper"]) * thinner**0.9 + a["slipper_law"] * x["slipper_extra"]
    gaps = a["laminar_flow"] * np.exp(x["ln_laminar"]) * thinner + a["laminar_law"] * x["laminar_extra"]
    orifice, laminar = x["system_orifice"], a["system_law"] * thinner * x["system_laminar"]
    on_top = {
        "slippers": slippers - a["slipper_flow"],
        "laminar": gaps - a["laminar_flow"],
        "throttled": x["throttled"],
        "system": orifice + laminar,
        "bleed": x["bleed"],
    }
    # every flow out of the high-pressure side sags the regulated pressure; the droop scales all of it
    sag = sum(a[f"by_{name}"] * flow for name, flow in on_top.items())
    droop = np.exp(x["ln_droop"])
    difference = a["regulated_difference"] + x["setting"] + a["warmth"] * x["softening"] - a["droop"]
    difference += droop * (a["droop"] + sag + (a["by_setting"] - 1.0) * x["setting"])
    free, difference = difference, at_least(difference, 0.05 * a["regulated_difference"] + 0.0j)
    r = difference / a["regulated_difference"]
    valve = a["compensator_flow"] + a["compensator_by_setting"] * x["setting"]
    valve += sum(a[f"compensator_by_{name}"] * flow for name, flow in on_top.items())
    case_flow = r * (slippers + gaps) + np.sqrt(r) * x["throttled"] + at_least(valve, 0.0j)
    # leaks of the circuit are counted at 175 bar
    share = difference / 175.0
    circuit = orifice * np.sqrt(share) + laminar * share
    back = 0.0j
    if a["shared"] == 1.0:
        through = a["load_flow"] + circuit + case_flow
        back = return_line(through, a["return_coefficient"], a["return_constant"], a["return_exponent"])
    # friction warms what flows through the case: as much as at the anchor over what carries it off
    carried = a["slipper_flow"] + a["laminar_flow"] + a["compensator_flow"] + a["heat_flow"]
    warmed = carried / (at_least(case_flow, 0.0j) + a["heat_flow"])
    nu = a["viscosity_ratio"] / thinner * np.exp(a["friction_warmth"] * (1.0 - warmed))
    w_nu = drain_weight(a["drain_weight_viscosity"] + x["drain_viscosity"])
    w_q = drain_weight(a["drain_weight_flow"] + x["drain_flow"])
    resistance = a["drain"] * np.exp(x["ln_drain"])
    turbulence = size(case_flow) / a["drain_flow"]
    own = 1.0 + w_nu * (nu - 1.0) + w_q * (turbulence - 1.0)
    # what clogs adds a share of the drain's own resistance: with its law, as a filter (viscous), or as an orifice
    clogged = own * x["drain_extra"] + nu * x["drain_viscous"] + turbulence * x["drain_orifice"]
    drain = resistance * case_flow * (own + clogged)
    load = a["load_flow"] / 20.0
    case = a["reservoir"] + x["reservoir"] + back + drain + a["warmth"] * x["case_warmth"]
    case += load * (x["load_case"] + a["warmth"] * x["load_warmth"]) + load**2 * x["load_case_square"]
    missed = load * x["load_discharge"] + load**2 * x["load_discharge_square"]
    return (case + difference + missed, case, case_flow), free != difference or valve.real < 0.0


@pytest.mark.parametrize("circuit", ["shared_return", "separate_drain"])
@pytest.mark.parametrize("wide", [0.0, 1.0, 3.0])
def test_pressures_and_slopes_are_those_of_the_plain_equations(circuit: str, wide: float) -> None:
    rng = np.random.default_rng(11)
    conditions = [
        Condition(rng.normal(4600, 40), rng.uniform(20, 90), rng.uniform(0, 2.5), rng.choice([0.0, 10.0, 20.0]))
        for _ in range(40)
    ]
    rows, solved = anchors(conditions, PUMP, circuit_parameters(circuit))
    assert solved.all()
    one_sided = {"throttled", "bleed", "system_orifice", "system_laminar", "slipper_extra", "laminar_extra"}
    one_sided |= {"drain_extra"}  # its law may lie on either side of the drain's own
    free = 0
    for row in rows:
        drawn = {name: wide * SPREAD[name] * rng.standard_normal() for name in c.COMPONENTS}
        state = {name: abs(v) if name in one_sided else v for name, v in drawn.items()}
        y, slopes = np.empty(2), np.empty((3, c.N_PLACES))
        flow = pressures(row, np.array([state[n] for n in c.COMPONENTS]), y, slopes)
        anchor = {name: float(row[column]) for name, column in COLUMN.items()}
        point = {name: complex(value) for name, value in state.items()}
        values, bound = plain(anchor, point)
        assert (y[0], y[1], flow) == pytest.approx([v.real for v in values], rel=1e-12, abs=1e-12)
        if bound:
            continue
        free += 1
        for i, name in enumerate(c.COMPONENTS):
            moved = {**point, name: point[name] + 1j * STEP}
            exact = [v.imag / STEP for v in plain(anchor, moved)[0]]
            assert slopes[:, c.PLACES[i]] == pytest.approx(exact, rel=1e-9, abs=1e-10), name
    assert free > len(rows) / 2
