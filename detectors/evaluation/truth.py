"""When a simulated fault is worth a word: the truth that stated probabilities are held against.

A judge that states the probability of a fault means one above that fault's own floor (``hypotheses.FaultKind.floor``):
what is smaller counts as healthy in its sums. So the truth of a record is the fault where its true change since the
installation reaches the floor, and health before.
"""

from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from detectors.bank.hypotheses import FAULT_KINDS
from detectors.evaluation.reality import Course
from detectors.evaluation.rows import Row
from detectors.words.verdict import State

Array = NDArray[np.float64]

_KIND_OF: Mapping[str, str] = {
    "slippers": "leakage, slippers",
    "port plate": "leakage, port plate",
    "three slippers": "uneven wear",
    "three pistons": "uneven wear",
    "one slipper": "uneven wear",
    "system": "system leakage",
    "drain": "drain restriction",
    "setting": "setting",
    "bleed": "bleed",
}
"""Judge's kind of fault by the simulated one; what it has no kind for counts as faulty from its onset on."""
_CHUNKS = 8
"""Chunks after which the kinds of every row have had their turns."""
_FLOORS = {k.name: k.floor for k in FAULT_KINDS}


def judges_kinds(row: Row) -> Counter[str]:
    """The judge's kinds of fault that a row stands for, by how many of its chunks have them; "" for none of its own."""
    found: Counter[str] = Counter()
    for chunk in range(_CHUNKS):
        courses = row.course.courses(1, row.n_flights, chunk)
        if courses:
            found[_KIND_OF.get(courses[0].kind, "")] += 1
    return found


def is_worth_a_word(row: Row, courses: tuple[Course, ...], n_pumps: int, sensor_floor_bar: float) -> NDArray[np.bool_]:
    """Flights on which the fault of the row exceeds its floor, shape (n_pumps, n_flights)."""
    shape = (n_pumps, row.n_flights)
    if row.truth is State.HEALTHY:
        return np.zeros(shape, dtype=np.bool_)
    if row.worn:
        return np.ones(shape, dtype=np.bool_)
    if not courses:
        sensing = row.sensing
        stepped = np.arange(row.n_flights) >= sensing.step_at
        seen = abs(sensing.case_zero_step) >= sensor_floor_bar or sensing.case_zero_step == 0.0
        return np.tile(stepped & seen, (n_pumps, 1))
    size = np.abs(courses[0].size)
    floor = _FLOORS[_KIND_OF[courses[0].kind]] if courses[0].kind in _KIND_OF else 0.0
    return np.asarray((size > 0.0) & (size >= floor))
