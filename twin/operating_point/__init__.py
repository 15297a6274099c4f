"""The cycle-averaged steady state of the pump, solved algebraically, one or a million at a time, with derivatives."""

from twin.operating_point.points import PROBLEMS, evenly_worn, operating_point, operating_points, problem, slipper_model
from twin.operating_point.validity import outside, validated

__all__ = [
    "PROBLEMS",
    "evenly_worn",
    "operating_point",
    "operating_points",
    "outside",
    "problem",
    "slipper_model",
    "validated",
]
