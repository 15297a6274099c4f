"""One flight as ten foreign systems export it: the files of ``docs/examples/exports``, written from its plain record.

``python -m tests.service.exports`` writes them anew; ``truth`` is what a reader has to find in each.
"""

import io
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from service.ingest.csv_format import parsed
from service.ingest.raw import Limits

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "examples" / "exports"
LIMITS = Limits(10**8, 10**6)
PSI = 0.0689475729316836
START = datetime(2026, 3, 18, 9, 49, 52, tzinfo=UTC)
NOMINAL_RPM = 4600.0
Columns = Mapping[str, Any]


def truth() -> dict[str, Any]:
    """Channels of the plain record, shape (n,) each."""
    return dict(parsed((FOLDER / "plain-record.csv").read_bytes(), LIMITS).tables[0].channels)


def _lines(header: list[str], rows: list[list[str]], separator: str = ",") -> str:
    return "\n".join([*header, *(separator.join(row) for row in rows)]) + "\n"


def engine_logger(c: Columns) -> bytes:
    """Three header lines, psi and degF, local date, time and offset, a text column, one row twice."""
    local = [START + timedelta(hours=1, seconds=float(t)) for t in c["time_s"]]
    rows = [
        [
            f"{at:%Y-%m-%d}", f" {at:%H:%M:%S}", "  +01:00", "       ", f"{p / PSI:7.1f}", f"{k / PSI:6.3f}", f"{n:7.0f}",
            f"{1.8 * t + 32.0:6.1f}", f"{r / PSI:6.3f}", " GND" if n < 100 else " FLT",
        ]
        for at, p, k, n, t, r in zip(
            local, c["discharge_pressure_bar"], c["case_pressure_bar"], c["shaft_speed_rpm"], c["fluid_temperature_degc"],
            c["reservoir_pressure_bar"], strict=True,
        )
    ]  # fmt: skip
    rows.insert(20, rows[20])
    header = [
        '#airframe_info, log_version="1.00", airframe_name="H225", system_id="0412"',
        "#yyyy-mm-dd, hh:mm:ss,   hh:mm,  ident,    psi,   psi,    rpm,  deg F,   psi, enum",
        "  Lcl Date, Lcl Time, UTCOfst, AtvWpt, HYD1 P, HYD1 C, HYD1 N, HYD1 T, HYD1 R, Phase",
    ]
    return _lines(header, rows).encode()


def data_logger(c: Columns) -> bytes:
    """A row of units under the header, -9999 for missing, seconds since switched on, a comment of semicolons."""
    rows = [
        [
            f"{t + 812.0:.1f}", f"{p / 10.0:.5f}", f"{k * 100.0:.3f}" if i != 7 else "-9999", f"{n / 60.0:.4f}", f"{d:.1f}",
            f"{r * 100.0:.3f}", "0",
        ]
        for i, (t, p, k, n, d, r) in enumerate(zip(
            c["time_s"], c["discharge_pressure_bar"], c["case_pressure_bar"], c["shaft_speed_rpm"],
            c["fluid_temperature_degc"], c["reservoir_pressure_bar"], strict=True,
        ))
    ]  # fmt: skip
    header = ["Time;Pump outlet pressure;Case drain pressure;Shaft speed;Oil temperature;Tank pressure;Spare 1"]
    return _lines([*header, "sec;MPa;kPa(g);Hz;deg C;kPa(g);-"], rows, ";").encode()


def space_separated(c: Columns) -> bytes:
    """Runs of blanks, no header."""
    kept = ("time_s", "discharge_pressure_bar", "case_pressure_bar", "shaft_speed_rpm", "fluid_temperature_degc")
    columns = [c[name] for name in kept]
    rows = [f"{t:8.2f} {p:10.4f} {k:9.6f} {n:8.1f} {d:7.2f}" for t, p, k, n, d in zip(*columns, strict=True)]
    return ("\n".join(rows) + "\n").encode()


def german(c: Columns) -> bytes:
    """Semicolons, decimal commas, Latin-1, names and dates in German."""
    local = [START + timedelta(hours=1, seconds=float(t)) for t in c["time_s"]]
    rows = [
        [f"{at:%d.%m.%Y %H:%M:%S}", *(f"{x:.6g}".replace(".", ",") for x in values)]
        for at, *values in zip(
            local, c["discharge_pressure_bar"], c["case_pressure_bar"], c["shaft_speed_rpm"],
            c["fluid_temperature_degc"], c["reservoir_pressure_bar"], strict=True,
        )
    ]  # fmt: skip
    header = ["Zeit;Systemdruck [bar];Gehäusedruck [bar];Drehzahl [1/min];Öltemperatur [°C];Behälterdruck [bar]"]
    return _lines(header, rows, ";").encode("latin-1")


def spreadsheet(c: Columns) -> bytes:
    """A spreadsheet's export: a mark of UTF-8, a preamble, thousands in groups, N/A, totals at the end."""
    rows = [
        [f"{t:.0f}", f'"{1e3 * p:,.1f}"', f"{k:.6f}" if i != 11 else "N/A", f'"{n:,.0f}"', f"{d:.1f}", f"{r:.6f}"]
        for i, (t, p, k, n, d, r) in enumerate(zip(
            c["time_s"], c["discharge_pressure_bar"], c["case_pressure_bar"], c["shaft_speed_rpm"],
            c["fluid_temperature_degc"], c["reservoir_pressure_bar"], strict=True,
        ))
    ]  # fmt: skip
    header = [
        "Hydraulic test report", "Aircraft,F-HCAA", "Operator,J. Smith", "",
        "Elapsed (s),System pressure (mbar),Case pressure (bar),Pump speed (rpm),Fluid temp (degC),Reservoir pressure (bar)",
    ]  # fmt: skip
    footer = ["", "Maximum,,1.2,,,", f"Rows,{len(rows)},,,,"]
    return b"\xef\xbb\xbf" + (_lines(header, rows) + "\n".join(footer) + "\n").encode()


def coarse_clock(c: Columns) -> bytes:
    """Two samples a second by a clock of whole seconds, and the night between two days."""
    half = np.repeat(np.arange(len(c["time_s"])), 2)
    midnight = datetime(2026, 3, 18, 23, 58, 30, tzinfo=UTC)
    rows = [
        [f"{midnight + timedelta(seconds=i // 2):%H:%M:%S}", f"{p:.4f}", f"{k:.6f}", f"{n:.0f}", f"{d:.1f}", f"{r:.6f}"]
        for i, (p, k, n, d, r) in enumerate(zip(
            c["discharge_pressure_bar"][half], c["case_pressure_bar"][half], c["shaft_speed_rpm"][half],
            c["fluid_temperature_degc"][half], c["reservoir_pressure_bar"][half], strict=True,
        ))
    ]  # fmt: skip
    header = ["# date: 2026-03-18", "UTC\tP discharge\tP case\tN pump\tT fluid\tP reservoir"]
    return _lines(header, rows, "\t").encode()


def computed(c: Columns) -> bytes:
    """Minutes as a clock, speed in percent, the case measured against the tank by a sensor that is half a second late."""
    rows = [
        [f"{t / 60.0:.6f}", f"{p:.4f}", f"{k - r:.6f}", f"{100.0 * n / NOMINAL_RPM:.3f}", f"{d + 273.15:.2f}", f"{r + 1.0:.6f}"]
        for t, p, k, n, d, r in zip(
            c["time_s"], c["discharge_pressure_bar"], c["case_pressure_bar"], c["shaft_speed_rpm"],
            c["fluid_temperature_degc"], c["reservoir_pressure_bar"], strict=True,
        )
    ]  # fmt: skip
    header = [
        "% test bench 4, run 318",
        "% minutes,bar,bar,percent,K,bar abs",
        "minutes,p1,dp_case,n_percent,t1,p_tank",
    ]
    return _lines(header, rows).encode()


def rig(c: Columns) -> bytes:
    """A rig at constant speed, which it does not record; instants with microseconds; running from the first row to the last."""
    runs = np.flatnonzero(c["shaft_speed_rpm"] > 4500.0)
    rows = [
        [
            (START + timedelta(seconds=float(c["time_s"][i]))).strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
            f"{c['discharge_pressure_bar'][i]:.4f}",
        ]
        + [f"{c[name][i]:.6f}" for name in ("case_pressure_bar", "reservoir_pressure_bar", "fluid_temperature_degc")]
        for i in runs
    ]
    return _lines(["timestamp,PS1,PS2,PS3,TS1"], rows).encode()


def structs(c: Columns) -> bytes:
    """A flight-test system's MATLAB file: structs of structs with data and units."""
    from scipy.io import savemat

    def signal(data: Any, units: str) -> dict[str, Any]:
        return {"data": np.asarray(data).reshape(-1, 1), "units": units}

    hydraulics = {
        "time": signal(c["time_s"], "s"),
        "PHYD1": signal(c["discharge_pressure_bar"] / PSI, "psi"),
        "PCASE": signal(c["case_pressure_bar"] / PSI, "psi"),
        "NHYD1": signal(c["shaft_speed_rpm"], "rpm"),
        "THYD1": signal(1.8 * c["fluid_temperature_degc"] + 32.0, "degF"),
        "PTANK": signal(c["reservoir_pressure_bar"] / PSI, "psi"),
    }
    buffer = io.BytesIO()
    savemat(buffer, {"HYD": hydraulics, "tail": "F-HCAA", "flight": "318", "pump_serial": "SN-0412"})
    return buffer.getvalue()


def acquisition(c: Columns) -> bytes:
    """A multi-rate acquisition file: pressures and speed each second, temperature every four, in groups of their own."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    def channel(group: str, name: str, data: Any, step: float, unit: str) -> Any:
        properties = {
            "wf_start_time": np.datetime64(START.replace(tzinfo=None)), "wf_increment": step, "wf_start_offset": 0.0,
            "unit_string": unit,
        }  # fmt: skip
        return ChannelObject(group, name, np.asarray(data, dtype=np.float64), properties=properties)

    buffer = io.BytesIO()
    objects = [
        RootObject(properties={"Tail": "F-HCAA"}),
        GroupObject("Hydraulics", properties={"SerialNo": "SN-0412"}),
        channel("Hydraulics", "Discharge", c["discharge_pressure_bar"] / PSI, 1.0, "psi"),
        channel("Hydraulics", "Case", c["case_pressure_bar"] / PSI, 1.0, "psi"),
        channel("Hydraulics", "Reservoir", c["reservoir_pressure_bar"] / PSI, 1.0, "psi"),
        channel("Drive", "Speed", c["shaft_speed_rpm"] / 60.0, 1.0, "Hz"),
        channel("Slow", "Temperature", c["fluid_temperature_degc"][::4], 4.0, "degC"),
    ]
    with TdmsWriter(buffer) as writer:
        writer.write_segment(objects)
    return buffer.getvalue()


EXPORTS: dict[str, Callable[[Columns], bytes]] = {
    "engine-logger.csv": engine_logger,
    "data-logger.csv": data_logger,
    "flight-test-structs.mat": structs,
    "rig-without-speed.csv": rig,
    "acquisition.tdms": acquisition,
    "space-separated.csv": space_separated,
    "german.csv": german,
    "F-HCAA_SN-0412_317_20260317-0949.csv": spreadsheet,
    "coarse-clock.csv": coarse_clock,
    "computed.csv": computed,
}


def main() -> None:
    """Write every export anew."""
    columns = truth()
    for name, export in EXPORTS.items():
        (FOLDER / name).write_bytes(export(columns))


if __name__ == "__main__":
    main()
