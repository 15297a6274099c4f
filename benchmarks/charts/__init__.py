"""Sequential charts behind one contract: CUSUM, EWMA, GLR, log evidence; thresholds from a wanted ARL0.

Charts take values in standard deviations of the healthy pump (``Standardised`` brings any channel there) and never
reset themselves: what an alarm means, and when a new run starts, is for the caller to say.
"""

from benchmarks.charts.calibration import Calibration, calibrated_threshold, independent_normal
from benchmarks.charts.contract import Chart, Sequence, run
from benchmarks.charts.cusum import Cusum, Side, cusum_arl, cusum_threshold, siegmund_arl
from benchmarks.charts.evidence import EvidenceChart, LevelChart
from benchmarks.charts.ewma import Ewma, ewma_arl, ewma_threshold
from benchmarks.charts.glr import Glr, Shape
from benchmarks.charts.glr_rate import glr_arl, glr_threshold
from benchmarks.charts.standardised import Standardised

__all__ = [
    "Calibration",
    "Chart",
    "Cusum",
    "EvidenceChart",
    "Ewma",
    "Glr",
    "LevelChart",
    "Sequence",
    "Shape",
    "Side",
    "Standardised",
    "calibrated_threshold",
    "cusum_arl",
    "cusum_threshold",
    "ewma_arl",
    "ewma_threshold",
    "glr_arl",
    "glr_threshold",
    "independent_normal",
    "run",
    "siegmund_arl",
]
