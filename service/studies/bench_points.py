"""Test-bench points from CSV: conditions and measured values with their standard deviations."""

import csv
import io
import math
from collections.abc import Mapping

from twin.condition import Condition
from twin.identification import MEASURED, Measurement, Point

_REQUIRED = ("speed_rpm", "fluid_temperature_degc")
_SUFFIX = "_sd"
_KNOWN = (*Condition._fields, *MEASURED, *(f"{name}{_SUFFIX}" for name in MEASURED))


class PointFaultsError(ValueError):
    """A file of points that is wrong; ``faults`` names everything found."""

    def __init__(self, faults: list[str]) -> None:
        super().__init__("; ".join(faults))
        self.faults = faults


def read_points(text: str) -> list[Point]:
    """Points of a CSV text.

    Columns are the fields of a condition (``speed_rpm``, ``fluid_temperature_degc``, perhaps
    ``reservoir_pressure_bar``, ``discharge_flow_lpm``, ``ambient_pressure_bar``) and, for each measured output ``name``,
    ``name`` and ``name_sd``. Empty cells were not measured; lines that start with ``#`` are remarks.

    Raises
    ------
    PointFaultsError
        with every fault, by line.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"]
    if not lines:
        raise PointFaultsError(["the file is empty"])
    header = [name.strip() for name in next(csv.reader(io.StringIO(lines[0][1])))]
    faults = [f"column {name!r} is not known; known: {', '.join(_KNOWN)}" for name in header if name not in _KNOWN]
    faults += [f"column {name!r} stands twice" for name in sorted({n for n in header if header.count(n) > 1})]
    faults += [f"column {name!r} is missing" for name in _REQUIRED if name not in header]
    faults += [
        f"column {name}{_SUFFIX} is missing: {name} needs its standard deviation"
        for name in MEASURED
        if name in header and f"{name}{_SUFFIX}" not in header
    ]
    points = []
    for number, line in lines[1:]:
        cells = next(csv.reader(io.StringIO(line)))
        if len(cells) != len(header):
            faults.append(f"line {number}: has {len(cells)} cells, the header has {len(header)}")
            continue
        values = _numbers(number, dict(zip(header, cells, strict=True)), faults)
        faults += [f"line {number}: {name} is missing" for name in _REQUIRED if name in header and name not in values]
        measured = _measured(number, values, faults)
        if all(name in values for name in _REQUIRED):
            condition = Condition(**{name: values[name] for name in Condition._fields if name in values})
            points.append(Point(condition, measured))
    if not points and not faults:
        faults.append("there is no point")
    if faults:
        raise PointFaultsError(faults)
    return points


def _numbers(line: int, cells: Mapping[str, str], faults: list[str]) -> dict[str, float]:
    values = {}
    for name, cell in cells.items():
        if not cell.strip():
            continue
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            faults.append(f"line {line}: {name} is {cell.strip()[:40]!r}, not a number")
            continue
        values[name] = value
    return values


def _measured(line: int, values: Mapping[str, float], faults: list[str]) -> dict[str, Measurement]:
    found = {}
    for name in MEASURED:
        if name not in values:
            continue
        deviation = values.get(f"{name}{_SUFFIX}", 0.0)
        if not deviation > 0.0:
            faults.append(f"line {line}: {name}{_SUFFIX} is missing or not above 0")
            continue
        found[name] = Measurement(values[name], deviation)
    return found
