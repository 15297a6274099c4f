"""Parameter sets as documents: a whole one, or a base with changes; read with every fault, and written again."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeGuard

from twin.condition import Condition
from twin.operating_point import operating_point, problem
from twin.parameters import Pump, PumpType, Quantity, Sensor, block
from twin.parts.geometry import geometry_faults
from twin.pumps import PUMP_TYPES, circuit_parameters
from twin.pumps.choices import CHOICES, code_of, offered
from twin.pumps.fluids import FLUIDS, with_fluid
from twin.recording import MAY_LACK

_GROUPS = ("quantities", "limits", "population")
_FRAME = ("nominal_speed_rpm", "nominal_reservoir_pressure_bar", "sensors")
_SIGHT = ("lacks", "own_twin")
_WHOLE = ("id", "title", *_FRAME, *_SIGHT, *_GROUPS)
_DERIVED = ("id", "base", "title", "fluid", "changes", *_FRAME, *_SIGHT)
_SENSOR = ("full_scale_bar", "accuracy_percent_full_scale", "repeatability_percent_full_scale")
_LIKE_UNITS = (("m", "mm", "um"), ("cm3", "mm3", "L"), ("bar", "MPa", "Pa"), ("rad", "deg"), ("N/m", "N/mm"))
_REFERENCE = PUMP_TYPES["h225"]
_LATER = (
    "limits.case_pressure_limit_bar",
    "quantities.drive.film_conductance",
    "quantities.drive.heat_share",
    "quantities.drive.case_conductance",
    *(f"population.{name}" for name in _REFERENCE.population if name.endswith("_onsets")),
)
"""Quantities that documents written by release 1.0 do not have; they stand for the reference's."""
_LONGEST = 500


class ParameterFaultsError(ValueError):
    """A document that is no parameter set; ``faults`` are (where, what is wrong) of everything found."""

    def __init__(self, faults: list[tuple[str, str]]) -> None:
        super().__init__("; ".join(f"{where}: {words}" for where, words in faults))
        self.faults = faults


def pump_type_from(document: Mapping[str, Any], bases: Mapping[str, PumpType] = PUMP_TYPES) -> PumpType:
    """Pump type that a document describes.

    Parameters
    ----------
    document
        Either all of ``id``, ``title``, ``nominal_speed_rpm`` [rpm], ``nominal_reservoir_pressure_bar`` [bar gauge],
        ``sensors``, ``quantities``, ``limits``, ``population``; or ``id``, ``base`` and ``changes``, a mapping from
        ``part.field``, ``limits.name`` or ``population.name`` to a quantity; with the frame's numbers and ``sensors``
        where they differ, and with ``fluid``, the product that fills it (``twin.pumps.fluids``). A quantity has ``value``,
        ``unit``, ``source`` and perhaps ``uncertainty``; the value of a choice may be its name (``twin.pumps.choices``).
        Dotted names may be nested tables, as TOML writes them. Either may say which channels its records ``lacks``, and that it
        has no twin of its own (``own_twin`` false): then its numbers stand in, and need not run at its speed and limits.
    bases
        Pump types that ``base`` may name.

    Raises
    ------
    ParameterFaultsError
        with every fault: names, units, numbers, geometry that cannot be, a pump that does not regulate.
    """
    faults: list[tuple[str, str]] = []
    allowed = _DERIVED if "base" in document else _WHOLE
    faults += [(name, "is not a field of a parameter set") for name in document if name not in allowed]
    name = text_from("id", document.get("id"), faults)
    if "base" in document:
        base = bases.get(str(document["base"]))
        if base is None:
            faults.append(("base", f"{document['base']!r} is not known; known: {', '.join(sorted(bases))}"))
        base = _filled(document, base or _REFERENCE, faults)
        groups = _changed(document, base, faults)
        frame = _reframed(document, base, faults)
        if "title" in document:
            frame = replace(frame, title=text_from("title", document["title"], faults))
        else:
            frame = replace(frame, title=f"{frame.title}, as {name}")
    else:
        groups = {group: _group(group, document.get(group), faults) for group in _GROUPS}
        frame = _frame(document, faults)
    frame = _sighted(document, frame, faults)
    if faults:
        raise ParameterFaultsError(faults)
    kind = replace(frame, name=name, pump=_pump(groups["quantities"]), **groups)  # type: ignore[arg-type]
    faults += [(fault.split(" ", 1)[0], fault.split(" ", 1)[1]) for fault in geometry_faults(kind.pump)]
    # what only stands in need not run where the real one does
    if not faults and kind.own_twin:
        faults += _running_faults(kind)
    if faults:
        raise ParameterFaultsError(faults)
    return kind


def document_of(kind: PumpType) -> dict[str, Any]:
    """A pump type as the whole document that ``pump_type_from`` reads."""
    sensors = {
        channel: {
            "full_scale_bar": sensor.full_scale_bar,
            "accuracy_percent_full_scale": 100.0 * sensor.accuracy_fs,
            "repeatability_percent_full_scale": 100.0 * sensor.repeatability_fs,
        }
        for channel, sensor in kind.sensors.items()
    }
    return {
        "id": kind.name,
        "title": kind.title,
        "nominal_speed_rpm": kind.nominal_speed_rpm,
        "nominal_reservoir_pressure_bar": kind.nominal_reservoir_pressure_bar,
        "sensors": sensors,
        **{group: {n: _plain(q) for n, q in getattr(kind, group).items()} for group in _GROUPS},
        **({"lacks": list(kind.lacks)} if kind.lacks else {}),
        **({} if kind.own_twin else {"own_twin": False}),
    }


def _plain(quantity: Quantity) -> dict[str, Any]:
    return {
        "value": quantity.value,
        "unit": quantity.unit,
        "source": quantity.source,
        "uncertainty": quantity.uncertainty,
    }


def _pump(quantities: Mapping[str, Quantity]) -> Pump:
    """Kernel parameters: the quantities of every part in SI."""
    parts: dict[str, Any] = {}
    for part, kind in Pump.__annotations__.items():
        fields = {path.partition(".")[2]: q for path, q in quantities.items() if path.partition(".")[0] == part}
        parts[part] = block(kind, fields)
    return Pump(**parts)


def _filled(document: Mapping[str, Any], base: PumpType, faults: list[tuple[str, str]]) -> PumpType:
    """The base filled with the document's fluid; changes of ``fluid.`` come after it."""
    name = document.get("fluid")
    if "fluid" not in document:
        return base
    if not isinstance(name, str) or name not in FLUIDS:
        faults.append(("fluid", f"{name!r} is not one of {', '.join(sorted(FLUIDS))}"))
        return base
    return with_fluid(base, name)


def _changed(
    document: Mapping[str, Any], base: PumpType, faults: list[tuple[str, str]]
) -> dict[str, Mapping[str, Quantity]]:
    given = document.get("changes")
    groups = {group: dict(getattr(base, group)) for group in _GROUPS}
    if "changes" not in document and any(name in document for name in ("fluid", *_FRAME, *_SIGHT)):
        return dict(groups.items())
    if not isinstance(given, Mapping) or not given:
        faults.append(("changes", "must name at least one quantity, e.g. slipper.h"))
        return {}
    for path, entry in _flat(given):
        where = f"changes.{path}"
        group, _, name = path.partition(".")
        target, name = (groups[group], name) if group in ("limits", "population") else (groups["quantities"], path)
        if name not in target:
            faults.append((where, "is no quantity of the base"))
            continue
        target[name] = quantity_from(where, entry, target[name], group in ("limits", "population"), faults)
    return dict(groups.items())


def _group(group: str, given: Any, faults: list[tuple[str, str]]) -> dict[str, Quantity]:
    reference: Mapping[str, Quantity] = getattr(_REFERENCE, group)
    found = dict(_flat(given)) if isinstance(given, Mapping) else {}
    faults += [(f"{group}.{name}", "is no quantity of a pump") for name in found if name not in reference]
    missing = [name for name in reference if name not in found and f"{group}.{name}" not in _LATER]
    faults += [(f"{group}.{name}", "is missing") for name in missing]
    return {
        name: quantity_from(f"{group}.{name}", found[name], like, group != "quantities", faults)
        if name in found
        else like
        for name, like in reference.items()
        if name not in missing
    }


def _flat(given: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Paths and quantities; tables without a ``value`` are levels of a path."""
    found: list[tuple[str, Any]] = []
    for name, entry in given.items():
        path = f"{prefix}{name}"
        nested = (
            isinstance(entry, Mapping) and "value" not in entry and any(isinstance(e, Mapping) for e in entry.values())
        )
        found += _flat(entry, f"{path}.") if nested else [(path, entry)]
    return found


def quantity_from(where: str, given: Any, like: Quantity, named_unit: bool, faults: list[tuple[str, str]]) -> Quantity:
    """A quantity, or ``like`` with the faults added; ``named_unit``: the unit stands in the name and cannot change."""
    if not isinstance(given, Mapping):
        faults.append((where, "must have value, unit and source"))
        return like
    known = ("value", "unit", "source", "uncertainty")
    faults += [(f"{where}.{name}", "is not a field of a quantity") for name in given if name not in known]
    value: Any = given.get("value")
    group, _, path = where.partition(".")
    if path in CHOICES:
        value = code_of(path, value)
        # a whole document may be a stored one, which verdicts rest on: it is read as it was
        if value is None and (group == "changes" or not is_number(given.get("value"))):
            faults.append((f"{where}.value", f"{given.get('value')!r} is not one of {offered(path)}"))
            return like
        value = given.get("value") if value is None else value
    unit, spread = given.get("unit"), given.get("uncertainty")
    before = len(faults)
    if not is_number(value):
        faults.append((f"{where}.value", "is missing or not a finite number"))
    allowed = (like.unit,) if named_unit else _like(like.unit)
    if unit not in allowed:
        faults.append((f"{where}.unit", f"{unit!r} is not {' or '.join(allowed)}"))
    if spread is not None and not (is_number(spread) and spread >= 0.0):
        faults.append((f"{where}.uncertainty", "is not a relative spread [-] of 0 or more"))
    source = text_from(f"{where}.source", given.get("source"), faults)
    if len(faults) > before:
        return like
    number = value if isinstance(value, int) and isinstance(like.value, int) else float(value)
    return Quantity(number, str(unit), source, None if spread is None else float(spread))


def _like(unit: str) -> tuple[str, ...]:
    """Units of the same kind."""
    return next((group for group in _LIKE_UNITS if unit in group), (unit,))


def _frame(document: Mapping[str, Any], faults: list[tuple[str, str]]) -> PumpType:
    title = text_from("title", document.get("title"), faults)
    speed = _between("nominal_speed_rpm", document, 200.0, 8000.0, faults)
    reservoir = _between("nominal_reservoir_pressure_bar", document, -0.9, 20.0, faults)
    given = document.get("sensors")
    sensors: dict[str, Sensor] = {}
    if not isinstance(given, Mapping):
        faults.append(("sensors", "is missing"))
        given = {}
    faults += [(f"sensors.{c}", "is missing") for c in _REFERENCE.sensors if c not in given]
    for channel, entry in given.items():
        where = f"sensors.{channel}"
        if channel not in _REFERENCE.sensors or not isinstance(entry, Mapping):
            faults.append((where, f"is not one of {', '.join(_REFERENCE.sensors)} with {', '.join(_SENSOR)}"))
            continue
        faults += [(f"{where}.{name}", "is not a field of a sensor") for name in entry if name not in _SENSOR]
        full = _between("full_scale_bar", entry, 0.01, 2000.0, faults, where)
        accuracy = _between("accuracy_percent_full_scale", entry, 1e-4, 10.0, faults, where)
        repeat = _between("repeatability_percent_full_scale", entry, 1e-4, 10.0, faults, where)
        sensors[channel] = Sensor(full, accuracy / 100.0, repeat / 100.0)
    return replace(
        _REFERENCE, title=title, nominal_speed_rpm=speed, nominal_reservoir_pressure_bar=reservoir, sensors=sensors
    )


def _reframed(document: Mapping[str, Any], base: PumpType, faults: list[tuple[str, str]]) -> PumpType:
    """The base with those numbers and sensors of the frame that a derived document states."""
    usual = document_of(base)
    stated = {name: document.get(name, usual[name]) for name in _FRAME}
    if isinstance(stated["sensors"], Mapping):
        stated["sensors"] = {**usual["sensors"], **stated["sensors"]}
    framed = _frame({**stated, "title": base.title}, faults)
    return replace(
        base,
        nominal_speed_rpm=framed.nominal_speed_rpm,
        nominal_reservoir_pressure_bar=framed.nominal_reservoir_pressure_bar,
        sensors=framed.sensors,
    )


def _sighted(document: Mapping[str, Any], frame: PumpType, faults: list[tuple[str, str]]) -> PumpType:
    """The frame with the channels that records of the type lack, and whether it has a twin of its own."""
    lacks, own = document.get("lacks", list(frame.lacks)), document.get("own_twin", frame.own_twin)
    if not isinstance(own, bool):
        faults.append(("own_twin", "is not true or false"))
        own = True
    if not isinstance(lacks, list):
        faults.append(("lacks", f"is not a list of channels; a type may lack {', '.join(MAY_LACK)}"))
        lacks = []
    faults += [
        (f"lacks.{i}", f"{name!r} is not one of {', '.join(MAY_LACK)}")
        for i, name in enumerate(lacks)
        if name not in MAY_LACK
    ]
    if {"discharge_pressure_bar", "case_pressure_bar"}.issubset(n for n in lacks if isinstance(n, str)):
        faults.append(("lacks", "names both pressures: nothing is left to judge by"))
    if faults:
        return frame
    return replace(frame, lacks=tuple(n for n in MAY_LACK if n in lacks), own_twin=own)


def _running_faults(kind: PumpType) -> list[tuple[str, str]]:
    """A pump must hold its pressure at zero flow where it is meant to run."""
    condition = Condition(kind.nominal_speed_rpm, 50.0, kind.nominal_reservoir_pressure_bar)
    points = operating_point(kind.pump, condition, circuit_parameters("shared_return"))
    fault = problem(points, 0)
    return [] if fault is None else [("pump", f"at {kind.nominal_speed_rpm:g} rpm, 50 degC and zero flow: {fault}")]


def _between(
    name: str, given: Mapping[str, Any], low: float, high: float, faults: list[tuple[str, str]], within: str = ""
) -> float:
    value = given.get(name)
    if not is_number(value) or not low <= float(value) <= high:
        faults.append((f"{within}.{name}" if within else name, f"is missing or not between {low:g} and {high:g}"))
        return low
    return float(value)


def is_number(value: Any) -> TypeGuard[int | float]:
    """Whether a value of a document is a finite number; a truth value is none."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def text_from(where: str, value: Any, faults: list[tuple[str, str]]) -> str:
    """A text of a document, or an empty one with the fault added."""
    if not isinstance(value, str) or not value.strip() or len(value) > _LONGEST or not value.isprintable():
        faults.append((where, f"is missing or not a text of 1 to {_LONGEST} printable characters"))
        return ""
    return value.strip()
