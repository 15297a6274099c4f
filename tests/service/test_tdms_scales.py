"""TDMS as DAQmx writes it: counts of a converter with a chain of scales, in interleaved buffers; right values or a refusal in words."""

import struct
from typing import Any

import numpy as np
import pytest

from service.errors import Problem
from service.ingest.decode import Limits, decode
from service.ingest.raw import RawFile
from service.ingest.tdms_format import parsed
from tests.service.records import METADATA, document

LIMITS = Limits(10_000_000, 1_000_000)
_NEW, _META, _RAW_DATA, _DAQMX = 4, 2, 8, 128
_RAW = 0xFFFFFFFF
Scale = list[dict[str, Any]]


def _text(words: str) -> bytes:
    raw = words.encode()
    return struct.pack("<I", len(raw)) + raw


def _properties(given: dict[str, Any]) -> bytes:
    out = struct.pack("<I", len(given))
    for name, value in given.items():
        out += _text(name)
        if isinstance(value, str):
            out += struct.pack("<I", 0x20) + _text(value)
        elif isinstance(value, float):
            out += struct.pack("<Id", 10, value)
        else:
            out += struct.pack("<II", 7, value)
    return out


def daqmx(channels: dict[str, tuple[np.ndarray, dict[str, Any]]], step_s: float) -> bytes:
    """A segment of one buffer in which the 32-bit counts of all channels alternate; scale 0 is what was counted."""
    n = len(next(iter(channels.values()))[0])
    width = 4 * len(channels)
    objects = [_text("/") + struct.pack("<I", _RAW) + _properties({})]
    objects.append(_text("/'rig'") + struct.pack("<I", _RAW) + _properties({}))
    for place, (name, (_, properties)) in enumerate(channels.items()):
        index = struct.pack("<IIIQ", 0x1269, _RAW, 1, n)
        index += struct.pack("<I", 1) + struct.pack("<IIIII", 5, 0, 4 * place, 0, 0)  # one scaler: int32 at its place
        index += struct.pack("<II", 1, width)
        own = {"wf_increment": step_s, "wf_start_offset": 0.0, **properties}
        objects.append(_text(f"/'rig'/'{name}'") + index + _properties(own))
    metadata = struct.pack("<I", len(objects)) + b"".join(objects)
    raw = np.column_stack([counts for counts, _ in channels.values()]).astype("<i4").tobytes()
    mask = _NEW | _META | _RAW_DATA | _DAQMX
    return b"TDSm" + struct.pack("<IIQQ", mask, 4713, len(metadata) + len(raw), len(metadata)) + metadata + raw


def scaled(*steps: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Properties of a chain behind what was counted, each step taking from the one before it."""
    found: dict[str, Any] = {"NI_Number_Of_Scales": len(steps) + 1, "NI_Scaling_Status": "unscaled", **more}
    for number, step in enumerate(steps, 1):
        kind = step["type"]
        found[f"NI_Scale[{number}]_Scale_Type"] = kind
        found[f"NI_Scale[{number}]_{kind}_Input_Source"] = step.get("source", number - 1)
        found |= {f"NI_Scale[{number}]_{kind}_{key}": v for key, v in step.items() if key not in ("type", "source")}
    return found


def polynomial(*coefficients: float) -> dict[str, Any]:
    named = {f"Coefficients[{i}]": c for i, c in enumerate(coefficients)}
    return {"type": "Polynomial", "Coefficients_Size": len(coefficients), **named}


def linear(slope: float, intercept: float) -> dict[str, Any]:
    return {"type": "Linear", "Slope": slope, "Y_Intercept": intercept}


def table(before: list[float], after: list[float]) -> dict[str, Any]:
    found: dict[str, Any] = {"type": "Table", "Pre_Scaled_Values_Size": len(before), "Scaled_Values_Size": len(after)}
    found |= {f"Pre_Scaled_Values[{i}]": x for i, x in enumerate(before)}
    return found | {f"Scaled_Values[{i}]": y for i, y in enumerate(after)}


def flight(**changes: dict[str, Any]) -> tuple[bytes, dict[str, np.ndarray]]:
    """The short record as a card has it: volts by a polynomial of the counts, then bar, rpm or degC by another step."""
    truth = {name: np.array(samples) for name, samples in document()["channels"].items() if name != "time_s"}
    chains = {
        # counts to volts, volts to what is measured
        "case_pressure_bar": (polynomial(0.0, 1e-6), linear(0.5, -0.1)),
        "discharge_pressure_bar": (polynomial(-1.0, 1e-6, 0.0), table([-1.0, 0.0, 9.0], [0.0, 25.0, 250.0])),
        "reservoir_pressure_bar": (polynomial(0.0, 1e-6), polynomial(-0.2, 0.25)),
        "fluid_temperature_degc": (linear(1e-5, 0.0),),
        "shaft_speed_rpm": (polynomial(0.0, 1e-6), linear(1000.0, 0.0), linear(1.0, 5.0)),
    }
    counts = {
        "case_pressure_bar": (truth["case_pressure_bar"] + 0.1) / 0.5e-6,
        "discharge_pressure_bar": (truth["discharge_pressure_bar"] / 25.0) / 1e-6,
        "reservoir_pressure_bar": (truth.get("reservoir_pressure_bar", np.zeros(1)) + 0.2) / 0.25e-6,
        "fluid_temperature_degc": truth["fluid_temperature_degc"] / 1e-5,
        "shaft_speed_rpm": (truth["shaft_speed_rpm"] - 5.0) / 1e-3,
    }
    wanted = {name: (counts[name], changes.get(name) or scaled(*chains[name])) for name in truth if name in chains}
    time = np.array(document()["channels"]["time_s"])
    return daqmx(wanted, float(time[1] - time[0])), {name: truth[name] for name in wanted}


def test_a_chain_of_scales_gives_what_was_measured() -> None:
    content, truth = flight()
    recording = decode(content, "application/x-tdms", "", METADATA, LIMITS).recording
    for name, samples in truth.items():
        assert np.allclose(recording[name], samples, atol=3e-3 if "speed" in name else 2e-5), name


def test_the_last_step_says_its_unit() -> None:
    thermistor = {
        "type": "Thermistor", "Excitation_Type": 10322, "Excitation_Value": 5.0, "Resistance_Configuration": 3,
        "R1_Reference_Resistance": 1e4, "Lead_Wire_Resistance": 0.0, "A": 1.295e-3, "B": 2.343e-4, "C": 1.018e-7,
        "Temperature_Offset": 0.0,
    }  # fmt: skip
    content, _ = flight(fluid_temperature_degc=scaled(polynomial(0.0, 2e-7), thermistor))
    raw = parsed(content, LIMITS)
    assert raw.tables[0].units["fluid_temperature_degc"] == "K"


def _refused(chain: dict[str, Any]) -> tuple[str, RawFile]:
    content, _ = flight(case_pressure_bar=chain)
    raw = parsed(content, LIMITS)
    with pytest.raises(Problem) as refused:
        decode(content, "application/x-tdms", "", METADATA, LIMITS)
    found = {fault.where: fault.problem for fault in refused.value.errors}
    assert list(found) == ["channels.case_pressure_bar"]
    return found["channels.case_pressure_bar"], raw


@pytest.mark.parametrize(
    ("chain", "words"),
    [
        (scaled(polynomial(0.0, 1e-6), {"type": "Reciprocal", "Factor": 1.0}), "'Reciprocal', a step that is not read"),
        (scaled(polynomial(0.0, 1e-6), {"type": "Linear", "Slope": 0.5}), "without NI_Scale[2]_Linear_Y_Intercept"),
        (scaled({**linear(1.0, 0.0), "source": 2}, {**linear(1.0, 0.0), "source": 1}), "lead back to themselves"),
        (scaled({**linear(1.0, 0.0), "source": 9}), "takes from step 9, which is not there"),
        (scaled(linear(1.0, 0.0)) | {"NI_Number_Of_Scales": 2_000_000_000}, "of 2000000000 steps"),
        (scaled(table([1.0, 0.0, 2.0], [0.0, 1.0, 2.0])), "cannot be computed"),
    ],
)
def test_a_chain_that_cannot_be_followed_is_no_measurement(chain: dict[str, Any], words: str) -> None:
    said, _ = _refused(chain)
    assert words in said
    assert "save it scaled" in said


def test_a_foreign_channel_of_such_a_scale_is_named_and_not_kept() -> None:
    content, _ = flight()
    counts = np.arange(len(document()["channels"]["time_s"]))
    truth = {n: np.array(v) for n, v in document()["channels"].items() if n != "time_s"}
    chain = scaled({"type": "Callback", "Factor": 1.0})
    own = {n: (np.round(1e4 * v), scaled(linear(1e-4, 0.0))) for n, v in truth.items()}
    content = daqmx({**own, "strain": (counts, chain)}, 1.0)
    raw = parsed(content, LIMITS)
    assert raw.not_kept["strain"] == "is scaled by 'Callback', a step that is not read: save it scaled"
    assert not raw.faults
