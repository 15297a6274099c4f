"""Servers in processes of their own whose database is really stopped, and who are killed: all that was acknowledged is done."""

import pytest

from benchmarks.kills import kills
from benchmarks.outage import outage

pytestmark = pytest.mark.study


@pytest.mark.parametrize("kind", ["postgres", "sqlite"])
@pytest.mark.usefixtures("postgres_cluster")  # skips, or fails, where its programs are missing
def test_an_outage_of_six_seconds_costs_nothing(kind: str) -> None:
    found = outage(kind, 2)
    assert found["faults"] == []
    assert found["done_within_60_s"] == 2


@pytest.mark.parametrize("kind", ["postgres", "sqlite"])
@pytest.mark.usefixtures("postgres_cluster")
def test_kills_at_random_moments_lose_and_double_nothing(kind: str) -> None:
    found = kills(kind, 0.7, seed=10_000)
    assert found["rounds"] > 0
    assert found["faults"] == []
    assert max([*found["takeovers_s"], *found["settled_s"]]) <= 60.0
