"""Compile every kernel of twin and detectors once, so that no request and no test pays for it."""

import subprocess
import sys
from datetime import UTC, datetime, timedelta
from functools import cache

import twin.warm_up
from detectors.isolability.bounds import isolability
from detectors.isolability.plan import Plan, sensors_of
from detectors.judgement.assessment import assess
from detectors.judgement.snapshot import judge_version
from detectors.words.observation import History, Mean, Observation, Reduction, Window, WindowKind, Zero
from detectors.words.thresholds import effective
from twin.condition import Condition
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type

_RECORDS = 13
"""Past the baseline and past one onset of faults: every branch of the bank has run."""


@cache
def warm_up() -> None:
    """Load or build the compiled code: operating point, transient pump, order surfaces, bank (minutes the first time)."""
    twin.warm_up.warm_up()
    _judge()


def _judge() -> None:
    judge_version()  # reads the sources
    pump, circuit = pump_type("h225"), circuit_parameters("shared_return")
    assess(History(tuple(_flight(i) for i in range(_RECORDS))), pump, circuit, effective({}))
    isolability(Plan(sensors_of(pump), baseline_flights=1, flights=1, burst=True), pump, circuit)


def _flight(i: int) -> Observation:
    """A record with one quiet window, made by hand."""
    means = {
        "discharge_pressure_bar": Mean(174.0, 0.02),
        "case_pressure_bar": Mean(0.5, 0.002),
        "shaft_speed_rpm": Mean(4600.0, 0.3),
        "fluid_temperature_degc": Mean(50.0, 0.1),
        "reservoir_pressure_bar": Mean(0.0, 0.001),
    }
    window = Window(WindowKind.ZERO_FLOW, 50.0, 150.0, True, None, means, 0.3)
    at = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(days=i)
    return Observation(str(i), at, "warm-up", "LH", str(i), Reduction(Zero(0.0, 0.007, measured=True), (window,), None))


def _main() -> None:
    """Two processes from nothing: the transient pump compiles beside the judge and the operating point."""
    with subprocess.Popen([sys.executable, "-m", "twin.warm_up"]) as beside:
        operating_point(pump_type("h225").pump, Condition(4600.0, 50.0), circuit_parameters("shared_return"))
        _judge()
    if beside.returncode:
        raise SystemExit(beside.returncode)
    warm_up()  # what one process lost to the other's last word


if __name__ == "__main__":
    _main()
