"""Calibration: a pump type's numbers from measured operating points, and what the points cannot tell."""

from twin.identification.fit import identify
from twin.identification.problem import DEFAULT_PARAMETERS, MEASURED, Measurement, Point
from twin.identification.result import Estimate, Identification, PointResidual, Undetermined

__all__ = [
    "DEFAULT_PARAMETERS",
    "MEASURED",
    "Estimate",
    "Identification",
    "Measurement",
    "Point",
    "PointResidual",
    "Undetermined",
    "identify",
]
