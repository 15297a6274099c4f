"""Compile every kernel once, so that no request and no test pays for it."""

from twin.condition import Condition
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type


def warm_up() -> None:
    """Solve one operating point with derivatives: loads or builds the compiled code (seconds the first time)."""
    operating_point(
        pump_type("h225").pump, Condition(4600.0, 50.0), circuit_parameters("shared_return"), derivatives=True
    )


if __name__ == "__main__":
    warm_up()
