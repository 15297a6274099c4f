"""The catalogue of one-line changes still speaks of this code."""

from benchmarks.mutants.__main__ import MUTANTS
from benchmarks.mutants.catalogue import faults


def test_every_line_of_the_catalogue_stands_once_in_its_module() -> None:
    assert faults(MUTANTS) == []


def test_every_area_is_there_and_no_change_twice() -> None:
    assert len(MUTANTS) >= 60
    assert len({m.name for m in MUTANTS}) == len(MUTANTS)
    assert {m.area for m in MUTANTS} >= {"laws", "reduction", "bank", "judgement", "layers", "access", "alarms"}
    assert all(m.fragment != m.replacement for m in MUTANTS)
