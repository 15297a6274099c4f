"""Scenario files: TOML to a scenario, with every fault of the file in one message."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from service.answers.documents import JsonObject
from service.ingest.metadata import KNOWN, checked_metadata
from twin.condition import CONDITION_INPUTS, HEALTH_INPUTS, Condition, Health
from twin.parameters import PumpType
from twin.parts.geometry import MOST_FREE_AIR
from twin.pumps.fluids import FLUIDS, with_fluid, with_free_air
from twin.simulation.mechanisms import MECHANISMS, mechanism
from twin.simulation.run import SLIPPER_GAPS, stepping
from twin.simulation.scenario import LONGEST_FLIGHT_S, LONGEST_RUN_S, STEP_RANGE_S, Scenario, Schedule, Value

DEFAULT_RATE_HZ = 1000.0
RATE_RANGE_HZ = (0.1, 1.0e6)
FORMS = ("transient", "quasi_steady")
DEFAULT_FLIGHT_RATE_HZ = 10.0
METADATA_KEYS = tuple(name for name in KNOWN if name not in ("pump_type", "pressure_reference", "ambient_pressure_bar"))
"""Keys of ``[metadata]``; the others follow from the simulation."""
_KEYS = (
    "title",
    "duration_s",
    "sample_rate_hz",
    "step_s",
    "start_flight_hours",
    "mechanism",
    "severity",
    "condition",
    "health",
    "changes",
    "metadata",
    "form",
    "fluid",
    "free_air",
    "slipper_gaps",
)
_TRANSIENT_ONLY = ("step_s", "mechanism", "slipper_gaps")
_INSTANTS = ("time_s", "flight_hours")


class ScenarioFaultsError(ValueError):
    """What is wrong with a scenario file, all of it."""

    def __init__(self, faults: list[str]) -> None:
        super().__init__("\n".join(faults))
        self.faults = faults


@dataclass(frozen=True, slots=True)
class ScenarioFile:
    """A scenario with how to run it and what its record says of itself.

    Attributes
    ----------
    sample_rate_hz
        Rate of the record [Hz].
    step_s
        Longest step [s]; None takes the twin's own.
    metadata
        Metadata of the flight record as texts.
    fluid, free_air
        Product that fills the pump, and its free air by volume at ambient pressure [-]; None: the pump type's own.
    slipper_gaps
        How the gap of slippers that follows from the forces is found (``twin.simulation.run.SLIPPER_GAPS``).
    """

    scenario: Scenario
    sample_rate_hz: float
    step_s: float | None
    metadata: Mapping[str, str]
    fluid: str | None = None
    free_air: float | None = None
    slipper_gaps: str = SLIPPER_GAPS[0]

    def filled(self, kind: PumpType) -> PumpType:
        """The pump type with the file's fluid and free air."""
        kind = with_fluid(kind, self.fluid)
        return kind if self.free_air is None else with_free_air(kind, self.free_air)


class _Reader:
    """Takes values out of a table and keeps what is wrong with them."""

    def __init__(self) -> None:
        self.faults: list[str] = []

    def known(self, where: str, table: Mapping[str, Any], known: tuple[str, ...]) -> None:
        for key in table:
            if key not in known:
                self.faults.append(f"{where}{key}: unknown key (known: {', '.join(known)})")

    def number(self, where: str, value: Any) -> float:
        """A number, or NaN with a fault."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.faults.append(f"{where}: is {_kind(value)}, not a number")
            return math.nan
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.faults.append(f"{where}: is not a finite number")
            return math.nan
        return number

    def bounded(self, where: str, value: Any, low: float, high: float, unit: str) -> float:
        number = self.number(where, value)
        if not low <= number <= high and not math.isnan(number):
            self.faults.append(f"{where} = {number:g} (allowed: {low:g} to {high:g}{unit})")
        return number

    def text(self, where: str, value: Any) -> str:
        if not isinstance(value, str):
            self.faults.append(f"{where}: is {_kind(value)}, not a text")
            return ""
        return value

    def one_of(self, where: str, value: Any, known: tuple[str, ...]) -> str | None:
        """A text among those that are known; None where nothing is said."""
        if value is not None and (not isinstance(value, str) or value not in known):
            self.faults.append(f"{where} = {value!r} (known: {', '.join(known)})")
            return None
        return None if value is None else str(value)

    def section(self, data: Mapping[str, Any], name: str) -> JsonObject:
        table = data.get(name, {})
        if not isinstance(table, dict):
            self.faults.append(f"{name}: is {_kind(table)}, not a table")
            return {}
        return table

    def inputs(self, data: Mapping[str, Any], section: str, names: tuple[str, ...]) -> dict[str, float]:
        table = self.section(data, section)
        self.known(f"{section}.", table, names)
        return {k: self.number(f"{section}.{k}", v) for k, v in table.items() if k in names}

    def change(self, where: str, value: Any) -> Value:
        """A constant, or a schedule over time or flight hours."""
        if not isinstance(value, dict):
            return self.number(where, value)
        axes = [axis for axis in _INSTANTS if axis in value]
        self.known(f"{where}.", value, (*_INSTANTS, "value"))
        if len(axes) != 1 or "value" not in value:
            self.faults.append(f"{where}: needs value and one of {', '.join(_INSTANTS)}")
            return math.nan
        at, values = (self._numbers(f"{where}.{key}", value[key]) for key in (axes[0], "value"))
        return Schedule(at, values, axes[0] == "flight_hours")

    def _numbers(self, where: str, value: Any) -> tuple[float, ...]:
        if not isinstance(value, list):
            self.faults.append(f"{where}: is {_kind(value)}, not a list of numbers")
            return (math.nan,)
        return tuple(self.number(f"{where}[{i}]", item) for i, item in enumerate(value))


def read_scenario(text: str, n_pistons: int) -> ScenarioFile:
    """Read a scenario file for a pump of so many pistons.

    Raises
    ------
    ScenarioFaultsError
        with every fault of the file, each with its place.
    """
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ScenarioFaultsError([f"not a TOML file: {error}"]) from None
    reader = _Reader()
    reader.known("", data, _KEYS)
    form = data.get("form", FORMS[0])
    if form not in FORMS:
        reader.faults.append(f"form = {form!r} (known: {', '.join(FORMS)})")
    flight = form == FORMS[1]
    longest = LONGEST_FLIGHT_S if flight else LONGEST_RUN_S
    duration = math.nan
    if "duration_s" in data:
        duration = reader.number("duration_s", data["duration_s"])
        if duration <= 0.0 or duration > longest:
            reader.faults.append(f"duration_s = {duration:g} (allowed: above 0 to {longest:g} s)")
    else:
        reader.faults.append("duration_s: is missing")
    rate = reader.bounded(
        "sample_rate_hz",
        data.get("sample_rate_hz", DEFAULT_FLIGHT_RATE_HZ if flight else DEFAULT_RATE_HZ),
        *RATE_RANGE_HZ,
        " Hz",
    )
    step = reader.bounded("step_s", data["step_s"], *STEP_RANGE_S, " s") if "step_s" in data else None
    if flight:
        reader.faults += [f"{key}: is for the transient form" for key in _TRANSIENT_ONLY if key in data]
    hours = reader.bounded("start_flight_hours", data.get("start_flight_hours", 0.0), 0.0, 1.0e6, " h")
    if hours > 0.0 and "flight_hours" not in reader.section(data, "metadata"):
        data["metadata"] = {**reader.section(data, "metadata"), "flight_hours": hours}
    metadata = _metadata(reader, data)
    fluid = reader.one_of("fluid", data.get("fluid"), tuple(sorted(FLUIDS)))
    gaps = reader.one_of("slipper_gaps", data.get("slipper_gaps"), SLIPPER_GAPS)
    air = reader.bounded("free_air", data["free_air"], 0.0, MOST_FREE_AIR, "") if "free_air" in data else None
    scenario = _scenario(reader, data, duration, hours)
    if scenario is not None:
        scenario = replace(scenario, quasi_steady=flight)
    if scenario is not None:
        # NaN stands for what has a fault already: healthy numbers in its place let the others be looked at
        try:
            _without_nan(scenario).table(n_pistons)
        except ValueError as problem:
            reader.faults += str(problem).removeprefix("the scenario cannot run: ").split("; ")
        if not reader.faults and not flight and stepping(scenario, rate, 1.0)[0] > scenario.duration_s:
            reader.faults.append(f"sample_rate_hz = {rate:g} gives no sample within duration_s = {duration:g}")
    if reader.faults or scenario is None:
        raise ScenarioFaultsError(reader.faults)
    return ScenarioFile(scenario, rate, step, metadata, fluid, air, gaps or SLIPPER_GAPS[0])


def _scenario(reader: _Reader, data: JsonObject, duration_s: float, hours: float) -> Scenario | None:
    title = reader.text("title", data.get("title", ""))
    values = reader.inputs(data, "condition", CONDITION_INPUTS)
    missing = [name for name in CONDITION_INPUTS if name not in Condition._field_defaults and name not in values]
    reader.faults += [f"condition.{name}: is missing" for name in missing]
    condition = Condition(**{**dict.fromkeys(missing, math.nan), **values})
    health = Health(**reader.inputs(data, "health", HEALTH_INPUTS))
    given = {name: reader.change(f"changes.{name}", v) for name, v in reader.section(data, "changes").items()}
    scenario = Scenario(duration_s, condition, health, given, hours, title)
    if "mechanism" not in data:
        if "severity" in data:
            reader.faults.append("severity: needs a mechanism")
        return scenario
    name = reader.text("mechanism", data["mechanism"])
    severity = reader.number("severity", data.get("severity", 1.0))
    if name not in MECHANISMS:
        reader.faults.append(f"mechanism = {name!r} (known: {', '.join(MECHANISMS)})")
        return scenario
    if severity < 0.0:
        reader.faults.append(f"severity = {severity:g} (allowed: 0 and more)")
    chosen = mechanism(name, condition, duration_s, severity if severity >= 0.0 else 0.0)
    # what the file says itself wins, so that a mechanism can be met under another load
    return replace(
        chosen,
        health=health,
        changes={**chosen.changes, **given},
        start_flight_hours=hours,
        title=title or chosen.title,
    )


def _metadata(reader: _Reader, data: Mapping[str, Any]) -> dict[str, str]:
    """Texts for the record; what is missing is missing, what is there must be right."""
    table = reader.section(data, "metadata")
    reader.known("metadata.", table, METADATA_KEYS)
    values = {
        name: value.isoformat() if isinstance(value, datetime) else value
        for name, value in table.items()
        if name in METADATA_KEYS
    }
    _, faults = checked_metadata(values)
    reader.faults += [f"metadata.{f.where}: {f.problem}" for f in faults if f.problem != "is missing"]
    return {name: str(value) for name, value in values.items()}


def _without_nan(scenario: Scenario) -> Scenario:
    """The same with a value that passes wherever a NaN stands for a fault that is known."""
    likely = Condition(3000.0, 50.0)
    condition = Condition(*(b if math.isnan(a) else a for a, b in zip(scenario.condition, likely, strict=True)))
    health = Health(*(b if math.isnan(a) else a for a, b in zip(scenario.health, Health(), strict=True)))
    whole = 1.0 if not 0.0 < scenario.duration_s <= LONGEST_FLIGHT_S else scenario.duration_s
    changes: dict[str, Value] = {}
    for name, change in scenario.changes.items():
        numbers = (*change.at, *change.values) if isinstance(change, Schedule) else (change,)
        if not any(math.isnan(v) for v in numbers):
            changes[name] = change
    hours = 0.0 if math.isnan(scenario.start_flight_hours) else scenario.start_flight_hours
    return Scenario(whole, condition, health, changes, hours, quasi_steady=scenario.quasi_steady)


def _kind(value: Any) -> str:
    names = {bool: "true or false", int: "a number", float: "a number", str: "a text", list: "a list", dict: "a table"}
    return names.get(type(value), "a date or time")
