"""Circuits as documents: shared return or separate drain, consumers that leak, an accumulator; read with every fault."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from twin.condition import Condition, Health
from twin.operating_point import operating_point, problem
from twin.parameters import Circuit, PumpType, Quantity, block
from twin.pumps import PUMP_TYPES
from twin.pumps.circuits import CIRCUIT_QUANTITIES
from twin.pumps.written import ParameterFaultsError, is_number, quantity_from, text_from
from twin.units import PA_PER_BAR, STANDARD_ATMOSPHERE_BAR

DRAINS: Mapping[str, float] = {"separate": 0.0, "shared": 1.0}
_FIELDS = ("id", "title", "base", "drain", "changes", "quantities", "consumers", "accumulator")
_RANGES: Mapping[str, tuple[float, float]] = {
    "k_c": (1.0e-3, 100.0),
    "k_c_slope": (-0.02, 0.02),
    "w_nu": (-0.5, 1.5),
    "w_Q": (-0.5, 1.5),
    "Q_ref": (0.01, 20.0),
    "k_inf": (0.0, 1.0),
    "k_inf_slope": (-0.02, 0.02),
    "K": (0.0, 1000.0),
    "K_slope": (-0.02, 0.02),
    "gamma": (0.0, 2.0),
    "T_ref": (273.15, 393.15),
}
"""In the unit of each number."""
MOST_CONSUMERS = 50
_LARGEST_LEAK_LPM = 20.0
_POLYTROPIC = 1.2
"""Exponent of the gas: between isothermal and adiabatic, for changes of a second (estimate)."""
_OIL_MODULUS_PA = 1.5e9
"""Of the oil that the accumulator is counted as: tangent at 175 bar and 50 degC without air."""


@dataclass(frozen=True, slots=True)
class Consumer:
    """Something at the discharge line that leaks when nobody moves it: so much at 175 bar, like an orifice."""

    name: str
    flow_lpm: float


@dataclass(frozen=True, slots=True)
class Accumulator:
    """Gas in the discharge line: volume [L] and gauge pressure [bar] before it is filled."""

    gas_volume_l: float
    precharge_bar: float


@dataclass(frozen=True, slots=True)
class CircuitSet:
    """A circuit with what stands in it.

    Attributes
    ----------
    circuit, quantities
        What the pump's ports see, as kernels take it and as it was stated.
    consumers
        Leaks of the healthy circuit; they add to ``system_leakage_lpm``.
    accumulator
        None where there is none; it moves nothing at rest.
    """

    name: str
    title: str
    circuit: Circuit
    quantities: Mapping[str, Quantity]
    consumers: tuple[Consumer, ...] = ()
    accumulator: Accumulator | None = None

    @property
    def leak_lpm(self) -> float:
        """What the consumers let through at 175 bar [L/min]."""
        return sum(consumer.flow_lpm for consumer in self.consumers)

    def around(self, kind: PumpType) -> PumpType:
        """The pump type with the accumulator as oil in its discharge line, linear about the regulated pressure."""
        if self.accumulator is None:
            return kind
        limits = kind.limits
        gauge = 0.5 * (limits["zero_flow_pressure_low_bar"].value + limits["zero_flow_pressure_high_bar"].value)
        pressure, before = (p + STANDARD_ATMOSPHERE_BAR for p in (gauge, self.accumulator.precharge_bar))
        if before >= pressure:
            return kind  # its bladder rests on the bottom: no oil gets in
        gas = 1.0e-3 * self.accumulator.gas_volume_l * (before / pressure) ** (1.0 / _POLYTROPIC)
        oil = _OIL_MODULUS_PA * gas / (_POLYTROPIC * pressure * PA_PER_BAR)
        volumes = kind.pump.volumes
        pump = kind.pump._replace(volumes=volumes._replace(discharge=volumes.discharge + oil))
        return replace(kind, pump=pump)


def _built_in(name: str, quantities: Mapping[str, Quantity]) -> CircuitSet:
    return CircuitSet(name, f"{name.replace('_', ' ')} of the thesis", block(Circuit, quantities), quantities)


CIRCUIT_SETS: Mapping[str, CircuitSet] = {name: _built_in(name, q) for name, q in CIRCUIT_QUANTITIES.items()}


def circuit_set_from(document: Mapping[str, Any], bases: Mapping[str, CircuitSet] = CIRCUIT_SETS) -> CircuitSet:
    """Circuit that a document describes.

    Parameters
    ----------
    document
        ``id``, perhaps ``title``; ``drain`` (``shared`` return or ``separate`` line); ``base`` with ``changes``, or all
        ``quantities``, each with value, unit, source and perhaps uncertainty; ``consumers``, a list of ``name`` and
        ``flow_lpm`` [L/min at 175 bar]; ``accumulator`` with ``gas_volume_l`` [L] and ``precharge_bar`` [bar gauge].
    bases
        Circuits that ``base`` may name.

    Raises
    ------
    ParameterFaultsError
        with every fault.
    """
    faults: list[tuple[str, str]] = [(n, "is not a field of a circuit") for n in document if n not in _FIELDS]
    name = text_from("id", document.get("id"), faults)
    base = bases.get(str(document.get("base", "shared_return")))
    if base is None:
        faults.append(("base", f"{document['base']!r} is not known; known: {', '.join(sorted(bases))}"))
        base = bases["shared_return"]
    title = text_from("title", document["title"], faults) if "title" in document else name
    quantities = _quantities(document, base, faults)
    drain = document.get("drain")
    if drain is not None and drain not in DRAINS:
        faults.append(("drain", f"{drain!r} is not one of {', '.join(DRAINS)}"))
    elif drain is not None:
        quantities["shared"] = Quantity(DRAINS[drain], "-", "as the document says")
    consumers = _consumers(document.get("consumers", _plain_consumers(base)), faults)
    accumulator = _accumulator(document.get("accumulator", _plain_accumulator(base)), faults)
    if faults:
        raise ParameterFaultsError(faults)
    found = CircuitSet(name, title, block(Circuit, quantities), quantities, consumers, accumulator)
    kind = PUMP_TYPES["h225"]
    condition = Condition(kind.nominal_speed_rpm, 50.0)
    point = operating_point(kind.pump, condition, found.circuit, Health(system_leakage_lpm=found.leak_lpm))
    fault = problem(point, 0)
    if fault is not None:
        raise ParameterFaultsError([("circuit", f"{kind.name} at 50 degC and zero flow: {fault}")])
    return found


def circuit_document(found: CircuitSet) -> dict[str, Any]:
    """A circuit as the whole document that ``circuit_set_from`` reads."""
    return {
        "id": found.name,
        "title": found.title,
        "drain": "shared" if found.circuit.shared > 0.5 else "separate",
        "quantities": {
            n: {"value": q.value, "unit": q.unit, "source": q.source, "uncertainty": q.uncertainty}
            for n, q in found.quantities.items()
            if n != "shared"
        },
        "consumers": _plain_consumers(found),
        "accumulator": _plain_accumulator(found),
    }


def _quantities(document: Mapping[str, Any], base: CircuitSet, faults: list[tuple[str, str]]) -> dict[str, Quantity]:
    quantities = dict(base.quantities)
    for group in ("changes", "quantities"):
        given = document.get(group, {})
        if not isinstance(given, Mapping):
            faults.append((group, "is no mapping from names to quantities"))
            continue
        for path, entry in given.items():
            where = f"{group}.{path}"
            if path not in _RANGES:
                faults.append((where, f"is no quantity of a circuit; known: {', '.join(_RANGES)}"))
                continue
            quantities[path] = quantity_from(where, entry, quantities[path], True, faults)
            low, high = _RANGES[path]
            if not low <= quantities[path].value <= high:
                words = f"{quantities[path].value:g} is not between {low:g} and {high:g} {quantities[path].unit}"
                faults.append((f"{where}.value", words))
    return quantities


def _consumers(given: Any, faults: list[tuple[str, str]]) -> tuple[Consumer, ...]:
    if not isinstance(given, list) or len(given) > MOST_CONSUMERS:
        faults.append(("consumers", f"is no list of at most {MOST_CONSUMERS} consumers"))
        return ()
    found = []
    for i, entry in enumerate(given):
        where = f"consumers.{i}"
        if not isinstance(entry, Mapping) or set(entry) != {"name", "flow_lpm"}:
            faults.append((where, "must have name and flow_lpm, and nothing else"))
            continue
        name, flow = text_from(f"{where}.name", entry["name"], faults), entry["flow_lpm"]
        if not is_number(flow) or not 0.0 <= flow <= _LARGEST_LEAK_LPM:
            faults.append((f"{where}.flow_lpm", f"is not between 0 and {_LARGEST_LEAK_LPM:g} L/min at 175 bar"))
            continue
        found.append(Consumer(name, float(flow)))
    return tuple(found)


def _accumulator(given: Any, faults: list[tuple[str, str]]) -> Accumulator | None:
    if given is None:
        return None
    if not isinstance(given, Mapping) or set(given) != {"gas_volume_l", "precharge_bar"}:
        faults.append(("accumulator", "must have gas_volume_l and precharge_bar, and nothing else"))
        return None
    values = []
    for name, (low, high) in {"gas_volume_l": (0.001, 20.0), "precharge_bar": (1.0, 400.0)}.items():
        value = given[name]
        if not is_number(value) or not low <= value <= high or not math.isfinite(value):
            faults.append((f"accumulator.{name}", f"is not between {low:g} and {high:g}"))
            value = low
        values.append(float(value))
    return Accumulator(*values)


def _plain_consumers(found: CircuitSet) -> list[dict[str, Any]]:
    return [{"name": c.name, "flow_lpm": c.flow_lpm} for c in found.consumers]


def _plain_accumulator(found: CircuitSet) -> dict[str, float] | None:
    a = found.accumulator
    return None if a is None else {"gas_volume_l": a.gas_volume_l, "precharge_bar": a.precharge_bar}
