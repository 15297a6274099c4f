"""Histories of a sound pump whose sensors begin to lie: files as operators send them, judged without a server.

What each sensor does is physics, not the judge's own model: a blocked snubber holds the reservoir's pressure, a frozen converter
one number, a short circuit its full scale while the pump runs, an absolute sensor adds the atmosphere.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from detectors.words.verdict import State, Verdict
from service.demo.fleet import PUMPS, pump_records
from service.ingest.raw import Limits
from service.studies.offline import analyse_files

Channels = dict[str, NDArray[np.float64]]
CASE, RESERVOIR, SPEED = "case_pressure_bar", "reservoir_pressure_bar", "shaft_speed_rpm"
FLIGHTS, FAILS = 36, 24
ATMOSPHERE_BAR = 1.013
SNUBBED = np.random.default_rng(7)


def reads_the_reservoir(channels: Channels) -> None:
    channels[CASE] = channels[RESERVOIR] + SNUBBED.normal(0.0, 0.003, len(channels[CASE]))


def frozen(channels: Channels) -> None:
    channels[CASE] = np.full(len(channels[CASE]), 0.446)


def frozen_while_running(channels: Channels) -> None:
    channels[CASE] = np.where(channels[SPEED] > 3000.0, 0.9, channels[CASE])


def toggling(channels: Channels) -> None:
    channels[CASE] = 0.446 + 0.0012 * (np.arange(len(channels[CASE])) % 2)


def at_full_scale(channels: Channels) -> None:
    channels[CASE] = np.where(channels[SPEED] > 3000.0, 5.0, channels[CASE])


def absolute(channels: Channels) -> None:
    channels[RESERVOIR] = channels[RESERVOIR] + ATMOSPHERE_BAR


def exchanged(channels: Channels) -> None:
    channels[CASE], channels[RESERVOIR] = channels[RESERVOIR], channels[CASE]


def without(channels: Channels) -> None:
    """A sound sensor stays as it is."""


LIES: dict[str, tuple[Callable[[Channels], None], set[str]]] = {
    "reads the reservoir": (reads_the_reservoir, {CASE}),
    "frozen": (frozen, {CASE}),
    "frozen while running": (frozen_while_running, {CASE}),
    "toggling by one bit": (toggling, {CASE}),
    "at full scale": (at_full_scale, {CASE}),
    "reservoir absolute": (absolute, {RESERVOIR}),
    "case and reservoir exchanged": (exchanged, {CASE, RESERVOIR}),
}


@pytest.fixture(scope="module")
def flights() -> list[bytes]:
    return [record.content for record in pump_records(PUMPS[0], FLIGHTS, seed=1)]


def written(flights: list[bytes], lie: Callable[[Channels], None], folder: Path) -> Iterator[Path]:
    """Files of the history: from flight ``FAILS`` on the sensor lies."""
    for number, content in enumerate(flights):
        lines = content.decode().splitlines()
        head = [line for line in lines if line.startswith("#")]
        names, *rows = (line.split(",") for line in lines if not line.startswith("#"))
        table = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
        channels = {name: table[:, k].copy() for k, name in enumerate(names)}
        if number >= FAILS:
            lie(channels)
        columns = zip(*(channels[name] for name in names), strict=True)
        body = [",".join("" if np.isnan(value) else f"{value:.7g}" for value in row) for row in columns]
        path = folder / f"{number:03d}.csv"
        path.write_text("\n".join([*head, ",".join(names), *body]) + "\n")
        yield path


def verdicts(flights: list[bytes], lie: Callable[[Channels], None], folder: Path) -> list[Verdict]:
    (pump,) = analyse_files(list(written(flights, lie, folder)), Limits(5_000_000, 100_000)).pumps
    return [assessment.verdict for assessment in pump.assessments]


@pytest.mark.parametrize("name", LIES)
@pytest.mark.postgres_in_study
def test_a_lying_sensor_is_named_and_nobody_else(name: str, flights: list[bytes], tmp_path: Path) -> None:
    lie, channels = LIES[name]
    said = verdicts(flights, lie, tmp_path)
    assert {v.state for v in said[8:FAILS]} == {State.HEALTHY}
    after = said[FAILS + 2 :]
    assert State.HEALTHY not in {v.state for v in after}
    last = after[-1]
    assert last.state is State.SENSOR_FAULT
    assert last.sensor in channels
    assert last.sensor is not None
    assert last.sensor.split("_")[0] in last.advice
    for verdict in said:
        assert "eplace the pump" not in verdict.advice or "Do not" in verdict.advice


def test_sound_sensors_leave_the_pump_healthy(flights: list[bytes], tmp_path: Path) -> None:
    said = verdicts(flights, without, tmp_path)
    assert {v.state for v in said[8:]} == {State.HEALTHY}
    assert said[-1].fit.explained >= said[-1].fit.records - 1
