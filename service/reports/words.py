"""Words, marks and formats that pages and reports share."""

from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

from jinja2 import pass_context
from jinja2.runtime import Context as Variables

from detectors.words.states import STATES
from service.reports.sentences import in_units
from service.units import UnitSystem, unit_of

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


def _system(variables: Variables) -> UnitSystem:
    found: UnitSystem = variables["system"]
    return found


@pass_context
def _word(variables: Variables, unit: str) -> str:
    return _system(variables).word(unit)


@pass_context
def _value(variables: Variables, value: float, unit: str) -> float:
    return _system(variables).value(value, unit)


@pass_context
def _figure(variables: Variables, value: float | None, unit: str, digits: int) -> str:
    return _system(variables).figure(value, unit, digits)


@pass_context
def _size(variables: Variables, value: float | None, unit: str, digits: int) -> str:
    return _system(variables).size(value, unit, digits)


@pass_context
def _said(variables: Variables, value: float, unit: str, digits: int | None = None) -> str:
    return _system(variables).said(value, unit, digits)


@pass_context
def _plain(variables: Variables, value: float, unit: str) -> str:
    return _system(variables).plain(value, unit)


@pass_context
def _sentence(variables: Variables, text: str) -> str:
    return in_units(text, _system(variables))


@pass_context
def _text(variables: Variables, value: float, unit: str) -> str:
    return _system(variables).text(value, unit)


FILTERS: Mapping[str, Callable[..., Any]] = {
    "day": lambda instant: f"{_instant(instant):%d %b %Y %H:%M} UTC" if instant else "–",
    "date": lambda instant: f"{_instant(instant):%d %b %Y}" if instant else "–",
    # "+ 0.0" turns a rounded minus zero into zero
    "number": lambda value, digits: f"{round(value, digits) + 0.0:.{digits}f}",
    # those of a template that is rendered with the reader's ``system`` of units
    "unit": _word,
    "in_unit": _value,
    "figure": _figure,
    "size": _size,
    "said": _said,
    "plain": _plain,
    "field": _text,
    "in_units": _sentence,
    "unit_of": unit_of,
}
"""Filters of the templates."""
