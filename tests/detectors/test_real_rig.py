"""The rig's benchmark on a small invented set of the same layout: three coolers, whole blocks held out."""

import itertools
from typing import Any

import numpy as np
import pytest

from benchmarks.real_rig import MOST_SPREAD_BAR, blocks, draw, study

TEMPERATURES = {3: 56.0, 20: 45.0, 100: 36.0}
FALL_BAR = (0.0, 0.26, 0.40)
N_CYCLES = 4


def archive(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Plateau at 190 bar that falls with temperature and pump leakage, in the nested order of the public set."""
    rows, pressure, temperature = [], [], []
    for cooler, accumulator, pump, valve in itertools.product(TEMPERATURES, (130, 90), (2, 1, 0), (73, 100)):
        oil = TEMPERATURES[cooler] + rng.uniform(-1.0, 1.0)
        shared = 0.02 * rng.normal()
        for _ in range(N_CYCLES):
            plateau = 191.4 - 0.065 * (oil - 36.0) - FALL_BAR[pump] + shared + 0.014 * rng.normal()
            cycle = np.full(60, 150.0) + rng.normal(size=60)
            cycle[2:8] = plateau + 0.02 * rng.normal(size=6)
            rows.append((cooler, valve, pump, accumulator, 0))
            pressure.append(cycle)
            temperature.append(np.full(60, oil) + 0.02 * rng.normal(size=60))
    return {
        "profile": np.array(rows),
        "cycle": np.arange(len(rows)),
        "PS1": np.array(pressure, dtype=np.float32),
        "TS1": np.array(temperature, dtype=np.float32),
    }


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    return study(archive(np.random.default_rng(1)))


@pytest.mark.parametrize("chart", ["CUSUM", "GLR"])
def test_leaks_are_found_and_circuit_faults_are_not(found: dict[str, Any], chart: str) -> None:
    rows = found["held_out_blocks"][chart]
    assert found["held_out_blocks"]["blocks"] == found["blocks"] == 36
    for key in ("found_weak_leakage", "found_severe_leakage"):
        assert rows[key]["n"] == rows[key]["of"] == 12 - found["held_out_blocks"]["outside_range"]
    assert rows["false_alarms"]["n"] == 0
    assert rows["false_alarms_with_valve_fault"]["of"] == 6


@pytest.mark.parametrize("cooler", [3, 20, 100])
def test_a_cooler_that_was_never_trained_is_outside_the_range(found: dict[str, Any], cooler: int) -> None:
    rows = found[f"never_trained_cooler_{cooler}"]
    # also the middle one, whose temperature lies between those that were trained
    assert rows["outside_range"] == rows["blocks"] == 12
    assert rows["alarms_in_blocks_outside"] == 0
    assert rows["outside_range_example"].startswith("oil temperature TS1")


def test_blocks_are_whole_conditions_without_gaps() -> None:
    data = archive(np.random.default_rng(2))
    assert len(blocks(data)) == 36
    assert {len(b.pressure) for b in blocks(data)} == {N_CYCLES}
    data["cycle"][2:] += 5
    assert len(blocks(data)) == 37
    data["profile"][:2, 4] = 1
    assert len(blocks(data)) == 36


def test_an_unsteady_plateau_gives_no_feature() -> None:
    data = archive(np.random.default_rng(3))
    data["PS1"][5, 2:5] += 5.0 * MOST_SPREAD_BAR
    pressure = np.concatenate([b.pressure for b in blocks(data)])
    assert np.flatnonzero(np.isnan(pressure)).tolist() == [5]


@pytest.mark.study
def test_the_labels_of_judged_blocks_do_not_matter(found: dict[str, Any]) -> None:
    plain = found["never_trained_valve_73"]
    other = archive(np.random.default_rng(1))
    judged = other["profile"][:, 1] == 73
    other["profile"][judged, 2] = (other["profile"][judged, 2] + 1) % 3
    swapped = study(other)["never_trained_valve_73"]
    for chart in ("CUSUM", "GLR"):
        keys = ("false_alarms", "found_weak_leakage", "found_severe_leakage")
        assert sum(plain[chart][k]["n"] for k in keys) == sum(swapped[chart][k]["n"] for k in keys)


def test_a_wrong_archive_is_refused_whole() -> None:
    with pytest.raises(ValueError, match="PS1 is missing; profile is missing"):
        blocks({"TS1": np.zeros((2, 60)), "cycle": np.arange(2)})
    data = archive(np.random.default_rng(5))
    with pytest.raises(ValueError, match=r"PS1 has shape .*TS1 has shape"):
        blocks({**data, "PS1": data["PS1"][:, :10], "TS1": data["TS1"][:3]})


def test_a_picture_is_drawn(tmp_path: Any) -> None:
    draw(archive(np.random.default_rng(6)), tmp_path / "rig.svg")
    assert "<svg" in (tmp_path / "rig.svg").read_text()
