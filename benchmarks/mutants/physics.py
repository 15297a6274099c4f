"""Changes of the twin's laws and of the reduced twin."""

from benchmarks.mutants.catalogue import Mutant

_BENCH = ("tests.twin.test_laws", "tests.twin.test_laws_compensator")
_REDUCED = ("tests.detectors.test_reduced_twin_referee",)


def _law(module: str, fragment: str, replacement: str) -> Mutant:
    return Mutant("laws", module, fragment, replacement, _BENCH, plain=True)


def _reduced(fragment: str, replacement: str) -> Mutant:
    return Mutant("reduced twin", "detectors.expectation.reduced_twin", fragment, replacement, _REDUCED, plain=True)


def _fluid(fragment: str, replacement: str) -> Mutant:
    select = "not order_surfaces and not laminar"
    return Mutant("fluids", "twin.pumps.fluids", fragment, replacement, ("tests.twin.test_fluids",), select)


def _bleed(fragment: str, replacement: str) -> Mutant:
    tests, select = ("tests.twin.test_absolute_pressure",), "of_its_end"
    return Mutant("laws", "twin.simulation.shared", fragment, replacement, tests, select, plain=True)


MUTANTS: tuple[Mutant, ...] = (
    _bleed("scene.bleed * th - g * faded * z", "scene.bleed * th"),
    _bleed("_BLEED_ROUNDS = 6", "_BLEED_ROUNDS = 1"),
    Mutant(
        "fluids",
        "twin.parts.geometry",
        "if not 1.0 <= nu <= 1000.0:",
        "if not nu <= 1000.0:",
        ("tests.twin.test_geometry",),
        "fluid",
    ),
    _fluid("(nu + 0.7)) for nu in", "(nu + 0.3)) for nu in"),
    _fluid("return math.hypot(", "return max("),
    _fluid("if _in_gaps(fluid, middle) > wanted else", "if _in_gaps(fluid, middle) < wanted else"),
    _fluid(
        'limits["reference_temperature_k"] = replace(acceptance, value=T',
        'limits["other"] = replace(acceptance, value=T',
    ),
    _law("twin.laws.gap", "1.0 + 1.5 * (e / b)", "1.0 + 2.5 * (e / b)"),
    _law("twin.laws.gap", "poiseuille + 0.5 * v_sum", "poiseuille + 1.0 * v_sum"),
    _law("twin.laws.gap", "(6.0 * mu * math.log(diameter_ratio))", "(12.0 * mu * math.log(diameter_ratio))"),
    _law("twin.laws.gap", "h**3 / (12.0 * mu) * shape", "h**3 / (6.0 * mu) * shape"),
    _law("twin.laws.gap", "K * K + 4.0 * G_land", "K * K + 2.0 * G_land"),
    _law("twin.laws.orifice", "min(delta_Re * math.sqrt(max(Re, 0.0)), C_d_inf)", "delta_Re * math.sqrt(max(Re, 0.0))"),
    _law("twin.laws.orifice", "math.tanh(2.0 * flow_number_ / lambda_crit)", "math.tanh(flow_number_ / lambda_crit)"),
    _law("twin.laws.orifice", "flow = C_q * area * math.sqrt(2.0 / rho", "flow = C_q * area * math.sqrt(1.0 / rho"),
    _law("twin.laws.fluid", "- 0.7) * 1.0e-6", "- 0.6) * 1.0e-6"),
    _law("twin.laws.fluid", "fluid.B_pressure_gain * (P - P_ATMOSPHERE)", "fluid.B_pressure_gain * P_ATMOSPHERE"),
    _law(
        "twin.laws.fluid",
        "math.exp(fluid.alpha_p * (P - P_ATMOSPHERE))",
        "math.exp(-fluid.alpha_p * (P - P_ATMOSPHERE))",
    ),
    _law(
        "twin.laws.fluid", "return (P_0 - P_1) / (rho_0 * fluid.c_p)", "return (P_0 - P_1) / (2.0 * rho_0 * fluid.c_p)"
    ),
    _law("twin.laws.fluid", "1.0 + y * 0.25 * e", "1.0 + y * 0.2 * e"),
    _law("twin.laws.lines", "w_Q * abs(Q) / Q_ref + 1.0 - w_nu - w_Q)", "w_Q * abs(Q) / Q_ref + 1.0 - w_nu)"),
    _law("twin.laws.lines", "quotient + gamma * ratio * by_ratio)", "quotient + ratio * by_ratio)"),
    _law("twin.laws.lines", "math.sqrt(abs(P_d - P_i) / k_d)", "math.sqrt(2.0 * abs(P_d - P_i) / k_d)"),
    _law("twin.laws.contact", "-3.0 * delta / delta_0", "-1.0 * delta / delta_0"),
    _law("twin.laws.contact", "min(elastic, abs(d * delta_dot))", "abs(d * delta_dot)"),
    _law("twin.laws.metering_edge", "(48.0 * edge.delta_lambda * edge.l)", "(24.0 * edge.delta_lambda * edge.l)"),
    _law("twin.laws.metering_edge", "math.sqrt(X * X + (X_0 + c) ** 2) - X_0", "math.sqrt(X * X + (X_0 + c) ** 2)"),
    _law("twin.laws.metering_edge", "r * r * math.acos(1.0 - x / r)", "r * r * math.acos(1.0 - 0.5 * x / r)"),
    _reduced("r = D / D_0", "r = 1.0"),
    _reduced("_COUNTED = ZERO_FLOW_BAR", "_COUNTED = 160.0"),
    _reduced("SLIPPER_VISCOSITY = 0.9", "SLIPPER_VISCOSITY = 0.8"),
    _reduced("+ (d - 1.0) * anchor[_DROOP]", "+ d * anchor[_DROOP]"),
    _reduced("2.0 * w_Q * flow_ratio + 1.0", "w_Q * flow_ratio + 1.0"),
    _reduced("return _LEAST_WEIGHT * (shrunk - 1.0), shrunk", "return _LEAST_WEIGHT * (shrunk - 1.0), 1.0"),
    _reduced("0.5 * throttled / (root * D_0)", "throttled / (root * D_0)"),
    _reduced(
        "_AT[c.SYSTEM_ORIFICE], by, 0.0, b_sys, c_sys, np.sqrt(share)",
        "_AT[c.SYSTEM_ORIFICE], by, 0.0, b_sys, c_sys, share",
    ),
    Mutant(
        "limits of the model",
        "twin.operating_point.validity",
        "- 0.5 * rho * through**2 / PA_PER_BAR",
        "- rho * through**2 / PA_PER_BAR",
        ("tests.twin.test_validity",),
    ),
    Mutant(
        "limits of the model",
        "twin.operating_point.points",
        "(absolute < 0.0).any(axis=1)",
        "(absolute < -9.0).any(axis=1)",
        ("tests.twin.test_validity",),
    ),
    Mutant(
        "scaling",
        "twin.pumps.own_limits",
        "if not low - margin <= pressure <= high + margin:",
        "if not pressure <= high + margin:",
        ("tests.twin.test_scaling",),
    ),
    Mutant(
        "identification",
        "twin.identification.fit",
        "jacobian.T @ jacobian + np.eye(len(offsets))",
        "jacobian.T @ jacobian + 9.0 * np.eye(len(offsets))",
        ("tests.twin.test_identification",),
    ),
)
