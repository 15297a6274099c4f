"""``docs/nomenclature.md`` names every parameter field of the twin with its unit, and nothing that is not there."""

import re
from pathlib import Path
from typing import get_type_hints

import pytest

from twin.condition import INPUTS, OUTPUTS, Condition, Health
from twin.parameters import Circuit, Pump, Quantity
from twin.pumps import pump_type
from twin.pumps.circuits import CIRCUIT_QUANTITIES
from twin.units import SI_PER_UNIT

PAGE = (Path(__file__).resolve().parent.parent.parent / "docs" / "nomenclature.md").read_text()
BLOCKS = {kind.__name__: (field, kind) for field, kind in get_type_hints(Pump).items()}
SI = {
    **dict.fromkeys(("mm", "um"), "m"), "mm2": "m2", **dict.fromkeys(("cm3", "mm3", "L"), "m3"),
    **dict.fromkeys(("bar", "MPa"), "Pa"), "deg": "rad", "g": "kg", "N/mm": "N/m", "N m/rad": "N m", "1/um": "1/m",
    "mm/s": "m/s", "bar/(L/min)": "Pa/(m3/s)", "bar/(L/min)^2": "Pa/(m3/s)^2", "L/min": "m3/s", "rpm": "rad/s",
}  # fmt: skip
"""Units that parameter sets are written in to those that kernels take; a radian counts as no unit in a stiffness."""
ENDINGS = {"rpm": "rpm", "degc": "degC", "bar": "bar", "lpm": "L/min", "deg": "deg", "nm": "N m", "um": "um"}
"""How a name at the edge ends, and its unit."""


def table(heading: str) -> dict[str, tuple[str, str, str]]:
    """Rows under a heading: field to meaning, unit, thesis."""
    found = re.search(rf"^### {heading}$(.*?)(?=^##|\Z)", PAGE, re.M | re.S)
    assert found is not None, heading
    cells = (line.strip("| ").split(" | ") for line in found[1].splitlines() if line.startswith("| `"))
    return {field.strip("`"): (meaning, unit, thesis) for field, meaning, unit, thesis in cells}


def si_unit(quantity: Quantity) -> str:
    return SI.get(quantity.unit, quantity.unit)


@pytest.mark.parametrize("name", sorted(BLOCKS))
def test_every_field_of_a_part_stands_there_with_the_unit_that_its_number_has(name: str) -> None:
    part, kind = BLOCKS[name]
    rows = table(name)
    assert list(rows) == list(kind._fields)
    quantities = pump_type("h225").quantities
    assert {f: unit for f, (_, unit, _) in rows.items()} == {
        f: si_unit(quantities[f"{part}.{f}"]) for f in kind._fields
    }


def test_every_field_of_a_circuit_stands_there_with_its_unit() -> None:
    rows = table("Circuit")
    assert list(rows) == list(Circuit._fields)
    for quantities in CIRCUIT_QUANTITIES.values():
        assert {f: unit for f, (_, unit, _) in rows.items()} == {f: si_unit(q) for f, q in quantities.items()}


def test_inputs_and_outputs_stand_there_with_the_unit_of_their_names() -> None:
    rows = table("Condition") | table("Health")
    assert (list(table("Condition")), list(table("Health"))) == (list(Condition._fields), list(Health._fields))
    assert tuple(rows) == INPUTS
    assert tuple(table("Outputs")) == OUTPUTS
    for name, (_, unit, _) in (rows | table("Outputs")).items():
        assert unit == ENDINGS.get(name.rpartition("_")[2], "-"), name


def test_every_row_says_something() -> None:
    for heading in (*BLOCKS, "Circuit", "Condition", "Health", "Outputs"):
        for field, (meaning, unit, thesis) in table(heading).items():
            assert len(meaning) > 3, field
            assert unit, field
            assert thesis, field


def test_units_of_parameter_sets_are_known_here() -> None:
    """Factors other than 1 belong to units that this page does not write: each must have its SI name above."""
    assert {u for u, factor in SI_PER_UNIT.items() if factor != 1.0} <= {*SI, "L/min/bar"}
