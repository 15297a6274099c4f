"""What a case sensor can detect and isolate, over its accuracy: the table and the pictures of docs/isolability.md.

Run as ``python -m benchmarks.isolability``; writes benchmarks/results/isolability.json, docs/images/isolability*.svg and the
tables of docs/isolability.md.
"""

import json
import math
from dataclasses import asdict
from pathlib import Path

from detectors.isolability.bounds import Isolability, isolability
from detectors.isolability.picture import isolability_svg, sensor_svg
from detectors.isolability.plan import Plan, sensors_of
from detectors.isolability.table import Row, case_sensor, sensor_table
from twin.pumps import circuit_parameters, pump_type

ROOT = Path(__file__).resolve().parent.parent
FULL_SCALES_BAR = (5.0, 10.0, 17.0)


_COMPARED = ("records at 1 Hz", "with ground runs", "with bursts")


def finite(value: object) -> object:
    """JSON without infinities: null where no size would do."""
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    return value


def main() -> None:
    """Compute, keep, draw."""
    pump, circuit = pump_type("h225"), circuit_parameters("shared_return")
    rows = sensor_table(pump, circuit)
    ranges = sensor_table(pump, circuit, [case_sensor(fs, 0.01) for fs in FULL_SCALES_BAR])
    plans = {
        "records at 1 Hz": Plan(sensors_of(pump)),
        "with bursts": Plan(sensors_of(pump), burst=True),
        "with ground runs": Plan(sensors_of(pump), ground_run_flows_lpm=(10.0, 20.0)),
        "with ground runs on every flight": Plan(
            sensors_of(pump), ground_run_flows_lpm=(10.0, 20.0), ground_run_every=1
        ),
        "long": Plan(sensors_of(pump), baseline_flights=100, flights=100),
        "long, with ground runs": Plan(
            sensors_of(pump), baseline_flights=100, flights=100, ground_run_flows_lpm=(10.0, 20.0)
        ),
        "one temperature": Plan(sensors_of(pump), temperature_range_degc=(50.0, 50.0)),
    }
    found = {name: isolability(plan, pump, circuit) for name, plan in plans.items()}
    document = {
        "command": "python -m benchmarks.isolability",
        "accuracy": [{k: finite(v) for k, v in asdict(r).items()} for r in rows],
        "full scale at 1 %": [{k: finite(v) for k, v in asdict(r).items()} for r in ranges],
        "faults": {
            name: [
                {
                    "fault": f.name,
                    "unit": f.unit,
                    "detectable": finite(f.smallest_detectable),
                    "isolable": finite(f.smallest_isolable),
                    "worst_rival": f.rivals[0].name,
                    "ambiguity_group": f.ambiguity_group,
                    "after_1_10_30_flights": [
                        [finite(float(f.detectable_by_flights[i])), finite(float(f.isolable_by_flights[i]))]
                        for i in (0, 9, 29)
                    ],
                }
                for f in result.faults
            ]
            for name, result in found.items()
        },
    }
    results = ROOT / "benchmarks" / "results" / "isolability.json"
    results.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    images = ROOT / "docs" / "images"
    title = "Pump leakage that a case sensor of 5 bar shows within 30 flights"
    (images / "isolability-sensors.svg").write_text(sensor_svg(rows, title), encoding="utf-8")
    picture = isolability_svg(found["records at 1 Hz"], "What the H225's sensors show at 1 Hz")
    (images / "isolability.svg").write_text(picture, encoding="utf-8")
    page = ROOT / "docs" / "isolability.md"
    words = page.read_text(encoding="utf-8")
    words = filled(words, "sensors", sensor_lines(rows))
    words = filled(words, "ranges", sensor_lines([r for r in ranges if r.reservoir_measured]))
    words = filled(words, "faults", fault_lines(*(found[name] for name in _COMPARED)))
    page.write_text(words, encoding="utf-8")


def filled(page: str, name: str, lines: list[str]) -> str:
    """The page with the lines between the marks of this name."""
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    head, rest = page.split(start)
    return head + start + "\n".join(lines) + "\n" + end + rest.split(end)[1]


def shown(size: float) -> str:
    """A size for a table; never where no size would do."""
    return f"{size:.3g}" if math.isfinite(size) else "never"


def sensor_lines(rows: list[Row]) -> list[str]:
    """Table of case sensors."""
    out = [
        "| case sensor | zero | reservoir sensor | burst | detected | isolated | isolated, any law "
        "| one-piston wear isolated | circuit leak isolated |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        flags = ("yes" if v else "no" for v in (r.zero_measured, r.reservoir_measured, r.burst))
        sizes = (r.detectable, r.isolable, r.isolable_any_law, r.uneven_isolable, r.system_isolable)
        cells = [f"{r.full_scale_bar:g} bar, {100 * r.accuracy_fs:g} %", *flags, *map(shown, sizes)]
        out.append("| " + " | ".join(cells) + " |")
    return out


def fault_lines(slow: Isolability, loaded: Isolability, fast: Isolability) -> list[str]:
    """Table of every fault: records alone, with ground runs every tenth flight, with bursts."""
    out = [
        "| fault | unit | detected after 1 / 10 / 30 flights | isolated after 10 / 30 | worst rival "
        "| with ground runs: detected / isolated after 30 | with bursts: detected / isolated after 30 |",
        "|---|---|---|---|---|---|---|",
    ]
    for a in slow.faults:
        others = [
            f"{shown(b.smallest_detectable)} / {shown(b.smallest_isolable)}"
            for b in (loaded.fault(a.name), fast.fault(a.name))
        ]
        detected = " / ".join(shown(float(a.detectable_by_flights[i])) for i in (0, 9, 29))
        isolated = " / ".join(shown(float(a.isolable_by_flights[i])) for i in (9, 29))
        out.append(f"| {a.name} | {a.unit} | {detected} | {isolated} | {a.rivals[0].name} | {' | '.join(others)} |")
    return out


if __name__ == "__main__":
    main()
