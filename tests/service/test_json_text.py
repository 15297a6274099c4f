"""JSON of the database: the same values as the standard library's, whichever of the two wrote it."""

import json
import math
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from service.storage.json_text import read, written

_LEAVES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(st.characters())
VALUES = st.recursive(
    _LEAVES, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4)
)


@settings(max_examples=200, deadline=None)
@given(VALUES)
def test_values_come_back_as_they_were(value: Any) -> None:
    assert read(written(value)) == value
    assert json.loads(written(value)) == value
    assert read(json.dumps(value)) == value


def test_what_only_the_standard_library_takes_is_kept_too() -> None:
    lone = {"note": "\ud800", "ids": [10**30, -(10**25)]}
    assert read(written(lone)) == lone
    assert read(json.dumps(lone)) == lone
    assert math.isinf(read(written([math.inf]))[0])
