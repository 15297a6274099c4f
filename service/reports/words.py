"""Words, marks and formats that pages and reports share."""

from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

from detectors.words.states import STATES

WORDS: Mapping[str, str] = {state.value: row.label for state, row in STATES.items()}
MARKS: Mapping[str, str] = {state.value: row.mark for state, row in STATES.items()}
ESTIMATE_NAMES: Mapping[str, str] = {
    "pump_leakage_change_lpm": "pump leakage, change",
    "system_leakage_change_lpm": "circuit leakage, change",
    "pressure_setting_change_bar": "pressure setting, change",
    "drain_resistance_change_percent": "drain resistance, change",
    "case_flow_at_reference_lpm": "case flow at reference condition",
}

ACTION_WORDS: Mapping[str, str] = {
    "filter_changed": "Filter of the case drain changed",
    "drain_cleaned": "Drain cleaned",
    "fluid_changed": "Fluid changed",
    "setting_adjusted": "Pressure setting adjusted",
    "sensor_replaced": "Sensor replaced",
    "pump_overhauled": "Pump overhauled",
}
"""What was done, in the order of ``detectors.words.observation.ACTIONS``."""


def _instant(value: datetime | str) -> datetime:
    return datetime.fromisoformat(value) if isinstance(value, str) else value


FILTERS: Mapping[str, Callable[..., Any]] = {
    "day": lambda instant: f"{_instant(instant):%d %b %Y %H:%M} UTC" if instant else "–",
    "date": lambda instant: f"{_instant(instant):%d %b %Y}" if instant else "–",
    # "+ 0.0" turns a rounded minus zero into zero
    "number": lambda value, digits: f"{round(value, digits) + 0.0:.{digits}f}",
}
"""Filters of the templates."""
