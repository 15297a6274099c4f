"""Parameter sets: units, sources, immutability, readable errors; one version per content."""

import pytest

from twin.parameters import Piston, PumpType, Quantity, block
from twin.pumps import PUMP_TYPES, circuit_parameters, pump_type
from twin.pumps.circuits import CIRCUIT_QUANTITIES
from twin.units import SI_PER_UNIT
from twin.version import numbers_hash


@pytest.mark.parametrize("kind", PUMP_TYPES.values(), ids=lambda k: k.name)
def test_every_number_has_unit_and_source(kind: PumpType) -> None:
    numbers = {f"{part}.{name}" for part in kind.pump._fields for name in getattr(kind.pump, part)._fields}
    assert numbers == set(kind.quantities)
    rates = {name: q for name, q in kind.population.items() if name.endswith("_onsets")}
    assert {q.unit for q in rates.values()} == {
        "1/1000 records"
    }  # of faults, not of the pump: no quantity of the twin's
    others = (q for name, q in kind.population.items() if name not in rates)
    for quantity in (*kind.quantities.values(), *kind.limits.values(), *others):
        assert quantity.unit in SI_PER_UNIT
        assert len(quantity.source) > 3


@pytest.mark.parametrize("name", CIRCUIT_QUANTITIES)
def test_circuit_numbers_are_those_of_their_quantities(name: str) -> None:
    circuit = circuit_parameters(name)
    for field, quantity in CIRCUIT_QUANTITIES[name].items():
        assert getattr(circuit, field) == quantity.si


def test_si_conversion_of_a_pressure_rate() -> None:
    # 0.337 bar/(L/min) by hand: 0.337e5 Pa over 1e-3/60 m3/s
    assert Quantity(0.337, "bar/(L/min)", "test").si == pytest.approx(0.337e5 * 60e3)


def test_a_block_names_all_missing_and_unknown_fields() -> None:
    with pytest.raises(ValueError, match=r"missing: n;.*missing: m;.*unknown: stroke"):
        block(Piston, {"d_p": Quantity(9, "mm", "t"), "stroke": Quantity(1, "mm", "t")})


def test_unknown_names_are_refused_with_what_exists() -> None:
    with pytest.raises(KeyError, match="known: h225"):
        pump_type("as332")
    with pytest.raises(KeyError, match="shared_return"):
        circuit_parameters("nowhere")


def test_version_follows_the_numbers() -> None:
    kind = pump_type("h225")
    changed = PumpType(
        **{
            **{f: getattr(kind, f) for f in PumpType.__dataclass_fields__},
            "quantities": {**kind.quantities, "slipper.h": Quantity(9.0, "um", "other")},
        }
    )
    assert numbers_hash(kind) == numbers_hash(pump_type("h225"))
    assert numbers_hash(changed) != numbers_hash(kind)
