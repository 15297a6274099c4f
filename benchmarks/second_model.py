"""Two models by two hands at random conditions: means of the NumPy pump beside those of the compiled one.

``python -m benchmarks.second_model`` writes ``benchmarks/results/second_model.json``; ``--count`` limits the conditions, which
are drawn one after another, so that a shorter run holds the first of a longer one. Some 25 s of a core each; a run goes on
behind the last condition that is kept, ``--again`` begins anew.
"""

import argparse
import json
import time
from collections.abc import Iterator
from itertools import islice

import numpy as np

from benchmarks import RESULTS, keep
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
_SETTLE = 24
"""Revolutions before the second model's mean: at half of them the regulated pressure still moves by 0.02 %, case flow by 0.1 %."""
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


def compared(condition: Condition, health: Health, settle: int = _SETTLE) -> dict[str, float]:
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
    """Go on comparing, and keep what was found after every condition."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=N_CONDITIONS)
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no condition after so long")
    parser.add_argument("--again", action="store_true", help="forget what is kept")
    asked = parser.parse_args()
    begun, rows = time.monotonic(), [] if asked.again else kept_rows()
    for condition, health in islice(conditions(asked.count), len(rows), None):
        if time.monotonic() - begun > asked.seconds:
            break
        rows.append([100.0 * difference for difference in compared(condition, health).values()])
        kept(rows)


def kept_rows() -> list[list[float]]:
    """Differences [%] of the conditions that are kept, in the order of ``NOMINAL``."""
    file = RESULTS / "second_model.json"
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return list(found.get("each_percent", []))


def kept(rows: list[list[float]]) -> None:
    """Write median and largest difference of each mean, and every condition's, in percent."""
    table = dict(zip(NOMINAL, np.abs(np.array(rows)).T, strict=True))
    differences = {n: {"median": float(np.median(v)), "largest": float(v.max()), "within_0.1": float((v < 0.1).mean())}
                   for n, v in table.items()}  # fmt: skip
    each = [[round(difference, 5) for difference in row] for row in rows]
    keep("second_model", {"conditions": len(rows), "of": N_CONDITIONS, "settled_revolutions": _SETTLE,
                          "difference_percent": differences, "each_percent": each})  # fmt: skip


if __name__ == "__main__":
    main()
