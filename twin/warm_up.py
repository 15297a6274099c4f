"""Compile the twin's kernels once, so that no request and no test pays for it (``detectors.warm_up``: all of them)."""

from twin.condition import Condition
from twin.operating_point import operating_point, outside
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario


def warm_up() -> None:
    """Solve one operating point with derivatives and two milliseconds of the transient pump: loads or builds the
    compiled code (minutes the first time).
    """
    kind, circuit, condition = pump_type("h225"), circuit_parameters("shared_return"), Condition(4600.0, 50.0)
    outside(kind, operating_point(kind.pump, condition, circuit, derivatives=True))
    simulate(kind.pump, circuit, Scenario(0.002, condition), sample_rate_hz=1000.0)


if __name__ == "__main__":
    warm_up()
