"""Two models by two hands at random conditions: means of the NumPy pump beside those of the compiled one.

``python -m benchmarks.second_model`` writes ``benchmarks/results/second_model.json``; ``--count`` limits the conditions, which
are drawn one after another, so that a shorter run holds the first of a longer one. Some 20 s of a core each.
"""

import argparse
import time
from collections.abc import Iterator

import numpy as np

from benchmarks import keep
from twin.condition import Condition, Health
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import steady_run
from twin.validation.second_model import SecondPump, Where

N_CONDITIONS = 200
NOMINAL: dict[str, float] = {
    "discharge_pressure_bar": 175.0,
    "case_pressure_bar": 1.0,
    "case_flow_lpm": 1.4,
    "shaft_torque_nm": 16.0,
}
"""What an error counts against where the value itself is small: acceptance sheet; of pressures the absolute value counts."""
_STEP_S = 10.0e-6
_GUESSED = ("discharge_pressure_bar", "case_pressure_bar", "return_pressure_bar", "control_pressure_bar",
            "swashplate_angle_deg")  # fmt: skip


def conditions(count: int) -> Iterator[tuple[Condition, Health]]:
    """The first ``count`` of the random conditions and health states."""
    rng = np.random.default_rng(11)
    for _ in range(count):
        condition = Condition(
            float(rng.uniform(2500, 5500)),
            float(rng.uniform(25, 95)),
            float(rng.uniform(0, 2.5)),
            float(rng.uniform(0, 14)),
        )
        yield (
            condition,
            Health(
                pump_leakage_scale=float(rng.uniform(0.6, 2.0)),
                slipper_leakage_scale=float(rng.uniform(0.8, 1.6)),
                system_leakage_lpm=float(rng.uniform(0, 3)),
                drain_resistance_scale=float(rng.uniform(0.8, 1.4)),
                pressure_setting_change_bar=float(rng.uniform(-3, 3)),
            ),
        )


def compared(condition: Condition, health: Health, settle: int = 12) -> dict[str, float]:
    """Relative differences of the means [-], second less first, by name."""
    pump, bench = pump_type("h225").pump, circuit_parameters("shared_return")
    numbers = {part: getattr(pump, part)._asdict() for part in pump._fields} | {"circuit": bench._asdict()}
    where = Where(
        *condition, health.pump_leakage_scale, health.slipper_leakage_scale, health.system_leakage_lpm,
        health.pressure_setting_change_bar, health.drain_resistance_scale,
    )  # fmt: skip
    point = operating_point(pump, condition, bench, health)
    second = SecondPump(numbers, where).means({name: float(point.value(name)[0]) for name in _GUESSED}, settle)
    first = steady_run(pump, condition, bench, health, settle_revolutions=120, mean_revolutions=4, step_s=_STEP_S)
    found = {}
    for name, nominal in NOMINAL.items():
        value = first.mean(name, 4)
        absolute = condition.ambient_pressure_bar if name.endswith("pressure_bar") else 0.0
        found[name] = (second[name] - value) / max(abs(value + absolute), nominal)
    return found


def main() -> None:
    """Compare and keep what was found, after every tenth condition."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=N_CONDITIONS)
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no condition after so long")
    asked = parser.parse_args()
    begun, rows = time.monotonic(), []
    for condition, health in conditions(asked.count):
        if time.monotonic() - begun > asked.seconds:
            break
        rows.append(compared(condition, health))
        if len(rows) % 10 == 0:
            kept(rows)
    kept(rows)


def kept(rows: list[dict[str, float]]) -> None:
    """Write median and largest difference of each mean, in percent."""
    table = {name: 100.0 * np.abs([row[name] for row in rows]) for name in NOMINAL}
    differences = {n: {"median": float(np.median(v)), "largest": float(v.max()), "within_0.1": float((v < 0.1).mean())}
                   for n, v in table.items()}  # fmt: skip
    keep("second_model", {"conditions": len(rows), "of": N_CONDITIONS, "difference_percent": differences})


if __name__ == "__main__":
    main()
