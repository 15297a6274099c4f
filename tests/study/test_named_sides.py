"""Rows in which wrong sides were named: 32 pumps each over the four realities, on a seed that nothing was set on."""

import pytest

from detectors.evaluation.reality import REALITIES
from detectors.words.states import SIDE_OF, Side
from tests.detectors.test_wrong_sides import BY_NAME, sides

pytestmark = pytest.mark.study

ROWS = {
    "drain x10 at once": 2,
    "drain x3 at flight 5": 1,
    "wear of 1 L/min in flights 1 to 9": 2,
    "wear of 0.6 L/min in 10 flights": 2,
    "wear of 1.5 L/min at once, bursts": 2,
    "system leakage 3 L/min at once, bursts": 2,
    "pump leakage 0.6 L/min": 1,
    "system leakage 3 L/min": 3,
    "uneven wear": 4,
}
"""How many of 32 may end on a wrong side: what was seen on two seeds; uneven wear without bursts is the row that is not good yet."""


@pytest.mark.parametrize(("row", "most"), list(ROWS.items()))
def test_few_are_told_a_wrong_side(row: str, most: int) -> None:
    """What cannot be parted stays undecided; that is allowed, a wrong side is not."""
    said = sides(BY_NAME[row], 17, tuple((r.name, chunk) for r in REALITIES for chunk in range(8)))
    right = SIDE_OF[BY_NAME[row].truth]
    assert sum(side in (Side.PUMP, Side.SYSTEM, Side.SENSOR) and side is not right for side in said) <= most
