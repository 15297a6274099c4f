"""One recording reduced and compared with the twin, as it is stored.

What this module imports is the code that a stored reduction was made by: ``sources`` is its hash.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

from detectors.expectation.residuals import window_residuals
from detectors.reduction.recording import reduce_recording
from detectors.words.observation import Mark, Window, WindowKind
from service.answers.documents import JsonObject
from service.answers.records import StoredReduction
from service.history.codec import reduction_to_json, residuals_to_json
from twin.parameters import Circuit, PumpType
from twin.recording import Recording
from twin.sources import sources_hash


class Reduced(NamedTuple):
    """A reduction and the residuals of its windows by number, as JSON objects."""

    reduction: StoredReduction
    residuals: JsonObject


def reduced(
    recording: Recording,
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    marks: Sequence[Mark] = (),
) -> Reduced:
    """Reduce a recording and compare its windows with the twin.

    Parameters
    ----------
    pump, circuit
        As the aircraft has them: with its fluid, sensors and return lines.
    thresholds
        All thresholds by key; those of windows and of the pump-off stretch count.
    marks
        Stretches that an engineer has called good or bad.
    """
    reduction = reduce_recording(recording, pump, thresholds, marks)
    residuals = {
        str(i): residuals_to_json(window_residuals(window, reduction.zero, pump, circuit))
        for i, window in enumerate(reduction.windows)
        if _is_comparable(window)
    }
    return Reduced(reduction_to_json(reduction), residuals)


@cache
def sources() -> str:
    """Hash over the sources of all that makes a stored reduction of a recording, its residuals among it."""
    return sources_hash(__name__)


def _is_comparable(window: Window) -> bool:
    return window.accepted and window.kind is not WindowKind.PUMP_OFF
