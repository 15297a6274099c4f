"""What a mapping can say: every part of its language applied to tables whose truth is known."""

from datetime import UTC, datetime, timedelta, timezone
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from service.ingest.file_names import NamePattern, named_by
from service.ingest.formulas import Formula
from service.ingest.mapped import Account, mapped, mapped_record
from service.ingest.mapping import ChannelMapping
from service.ingest.raw import RawFile, RawRecord, Table

N = 50
START = datetime(2026, 5, 2, 7, 11, tzinfo=UTC)


def columns(**changes: Any) -> dict[str, Any]:
    made: dict[str, Any] = {
        "time_s": np.arange(N) * 1.0,
        "discharge_pressure_bar": np.full(N, 174.0),
        "case_pressure_bar": 0.9 + 0.01 * np.arange(N),
        "shaft_speed_rpm": np.full(N, 4600.0),
        "fluid_temperature_degc": np.full(N, 50.0),
    }
    made |= changes
    return {name: np.array(v, dtype=float) for name, v in made.items() if v is not None}


def record(mapping: dict[str, Any], *tables: Table, metadata: dict[str, Any] | None = None) -> RawRecord:
    return mapped_record(RawFile(metadata or {}, tables), ChannelMapping.model_validate(mapping))


def problems(made: RawRecord) -> str:
    return "; ".join(f"{f.where}: {f.problem}" for f in made.faults)


def test_a_constant_stands_for_a_channel_that_the_file_lacks() -> None:
    rule = {"channel": "shaft_speed_rpm", "value": 76.0, "unit": "Hz"}
    made = record({"channels": [rule]}, Table(columns(shaft_speed_rpm=None)))
    assert made.faults == []
    assert (made.channels["shaft_speed_rpm"] == 4560.0).all()
    twice = record({"channels": [rule]}, Table(columns()))
    assert "as well" in problems(twice)


def test_one_source_stands_for_two_channels() -> None:
    rules = [{"source": "P", "channel": c, "unit": "psi"} for c in ("case_pressure_bar", "reservoir_pressure_bar")]
    made = record({"channels": rules}, Table(columns(case_pressure_bar=None, P=np.full(N, 14.5037738))))
    for name in ("case_pressure_bar", "reservoir_pressure_bar"):
        assert made.channels[name] == pytest.approx(np.ones(N))


def test_a_computed_channel_is_arithmetic_and_bears_missing_samples() -> None:
    low = np.full(N, 2.0)
    low[3] = np.nan
    rules = [
        {"channel": "reservoir_pressure_bar", "formula": "max({P low}, 0) * 2 + case_pressure_bar / 10", "unit": "kPa"}
    ]
    made = record({"channels": rules}, Table(columns(**{"P low": low})))
    wanted = (np.fmax(low, 0.0) * 2.0 + made.channels["case_pressure_bar"] / 10.0) / 100.0
    assert made.channels["reservoir_pressure_bar"] == pytest.approx(wanted)
    unknown = [{"channel": "reservoir_pressure_bar", "formula": "nothing * 2"}]
    assert "needs nothing" in problems(record({"channels": unknown}, Table(columns())))
    itself = [{"channel": "case_pressure_bar", "formula": "case_pressure_bar - 0.1"}]
    assert record({"channels": itself}, Table(columns())).channels["case_pressure_bar"][0] == pytest.approx(0.8)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')",
        "p.real",
        "p[0]",
        "2 ** p",
        "p ** 100",
        "1 + 1",
        "p if p else 1",
        "lambda: p",
        "p and q",
        "'a' * 3 + p",
        "True + p",
        "sqrt(p, p)",
        "-" * 200 + "p",
        "(" * 300 + "p" + ")" * 300,
        "p" * 600,
        "open(p)",
        "",
    ],
)
def test_a_formula_is_never_code(text: str) -> None:
    with pytest.raises(ValueError, match=r"formula|power|arguments"):
        Formula(text)


def test_what_is_no_number_is_missing() -> None:
    found = Formula("sqrt(p) + 1 / q")({"p": np.array([-1.0, 4.0, 4.0]), "q": np.array([1.0, 0.0, 2.0])})
    assert np.isnan(found[:2]).all()
    assert found[2] == 2.5


def test_a_delay_is_taken_off() -> None:
    time = np.arange(N) * 1.0
    late = np.interp(time - 2.5, time, np.sin(time / 5.0))
    rule = {"source": "late", "channel": "case_pressure_bar", "delay_s": 2.5}
    made = record({"channels": [rule]}, Table(columns(case_pressure_bar=None, late=late)))
    found = made.channels["case_pressure_bar"]
    assert found[3:45] == pytest.approx(np.sin(time / 5.0)[3:45], abs=0.02)
    assert np.isnan(found[-2:]).all()


def test_what_is_between_samples_is_held_or_interpolated_up_to_an_age() -> None:
    slow = np.full(N, np.nan)
    slow[[0, 5, 10, 40]] = [10.0, 20.0, 30.0, 60.0]
    for how, at_7 in (("hold", 20.0), ("linear", 24.0)):
        rule = {"source": "T", "channel": "fluid_temperature_degc", "between": how, "between_s": 6.0}
        found = record({"channels": [rule]}, Table(columns(fluid_temperature_degc=None, T=slow))).channels
        assert found["fluid_temperature_degc"][7] == at_7
        assert np.isnan(found["fluid_temperature_degc"][25])


def test_columns_are_left_out_and_tables_chosen() -> None:
    left = Table(columns(spare=np.ones(N)), name="LH", attributes={"serial": "P-1"})
    right = Table(columns(case_pressure_bar=np.zeros(N)), name="RH", attributes={"serial": "P-2"})
    made = record({"tables": ["L*"], "leave_out": ["sp*"], "metadata": {"LH.serial": "pump_serial"}}, left, right)
    assert "spare" not in made.channels
    assert made.metadata["pump_serial"] == "P-1"
    assert made.channels["case_pressure_bar"][0] == pytest.approx(0.9)
    assert "none is called so" in problems(record({"tables": ["X"]}, left))


def test_a_rule_takes_its_source_from_the_table_that_it_names() -> None:
    tables = (Table({"P": np.full(N, 1.0)}, name="a"), Table({"P": np.full(N, 2.0)}, name="b"))
    rule = {"source": "P", "channel": "case_pressure_bar", "table": "b"}
    made = mapped(RawFile({}, tables), ChannelMapping.model_validate({"channels": [rule]}))
    assert made.tables[1].channels["case_pressure_bar"][0] == 2.0
    assert made.tables[0].channels["P"][0] == 1.0
    undecided = ChannelMapping.model_validate({"channels": [{"source": "P", "channel": "case_pressure_bar"}]})
    faults = mapped(RawFile({}, tables), undecided).faults
    assert "is in 2 tables (a, b)" in faults[0].problem


def test_the_unit_of_the_file_is_used_and_contradicts_loudly() -> None:
    table = Table(columns(case_pressure_bar=None, P=np.full(N, 14.5037738)), units={"P": "psig", "spare": "?"})
    plain = {"source": "P", "channel": "case_pressure_bar"}
    made = record({"channels": [plain]}, table)
    assert made.channels["case_pressure_bar"] == pytest.approx(np.ones(N))
    assert made.references["case_pressure_bar"] == "gauge"
    assert "by the file and in 'kPa' by the mapping" in problems(
        record({"channels": [{**plain, "unit": "kPa"}]}, table)
    )
    wrong = Table(
        columns(), units={"shaft_speed_rpm": "Hz", "case_pressure_bar": "bara", "fluid_temperature_degc": "-"}
    )
    unmapped = mapped_record(RawFile({}, (wrong,)), None)
    assert problems(unmapped).startswith("channels.shaft_speed_rpm: is in 'Hz'")
    assert len(unmapped.faults) == 1
    assert unmapped.references == {"case_pressure_bar": "absolute"}


def test_metadata_come_from_constants_and_defaults() -> None:
    mapping = {"constants": {"position": "RH"}, "defaults": {"aircraft": "F-0", "flight_id": "1"}}
    made = record(mapping, Table(columns()), metadata={"position": "LH", "aircraft": "F-9"})
    assert (made.metadata["position"], made.metadata["aircraft"], made.metadata["flight_id"]) == ("RH", "F-9", "1")


def timed(rule: dict[str, Any], **texts: Any) -> RawRecord:
    cells = {n: v for n, v in texts.items() if isinstance(v[0], str | None)}
    numbers = {n: np.array(v, dtype=float) for n, v in texts.items() if n not in cells}
    n = len(next(iter(texts.values())))
    channels = {name: v[:n] for name, v in columns(time_s=None).items()}
    return record({"time": rule}, Table({**channels, **numbers}, texts=cells))


ZONES = {
    "UTC": UTC,
    "+02:00": timezone(timedelta(hours=2)),
    "-09:30": timezone(-timedelta(hours=9, minutes=30)),
    "Europe/Paris": ZoneInfo("Europe/Paris"),
    "America/New_York": ZoneInfo("America/New_York"),
}


@given(
    st.datetimes(datetime(1990, 1, 1), datetime(2037, 1, 1)),  # noqa: DTZ001 - a zone is drawn beside it
    st.sampled_from(list(ZONES)),
    st.sampled_from(
        [
            ("%Y-%m-%d %H:%M:%S", None),
            ("%Y-%m-%dT%H:%M:%S.%f", None),
            ("%d.%m.%Y %H:%M:%S", None),
            ("%d/%m/%Y %H:%M:%S", True),
            ("%m/%d/%Y %I:%M:%S %p", False),
            ("%Y%m%dT%H%M%S", None),
            ("%d-%b-%Y %H:%M:%S", "format"),
            ("%d-%b-%Y %H:%M:%S.%f", None),
            ("%d %B %Y %H:%M:%S", None),
            ("%d/%b/%Y:%H:%M:%S", "format"),
        ]
    ),
)
def test_instants_are_read_as_they_are_written(start: datetime, zone: str, written: tuple[str, Any]) -> None:
    form, day_first = written
    begin = start.replace(microsecond=0, tzinfo=UTC)
    local = [(begin + timedelta(seconds=i)).astimezone(ZONES[zone]) for i in range(5)]
    if len({moment.utcoffset() for moment in local}) > 1 or any(moment.fold for moment in local):
        return  # a change of the clock has a test of its own
    rule: dict[str, Any] = {"source": "utc", "zone": zone}
    rule |= {"format": form} if day_first == "format" else {"day_first": day_first}
    made = timed(rule, utc=[moment.strftime(form) for moment in local])
    assert made.faults == []
    assert datetime.fromisoformat(made.metadata["started_at"]) == begin
    assert made.channels["time_s"] == pytest.approx(np.arange(5.0), abs=1e-5)


def test_a_change_of_the_clock_costs_no_hour() -> None:
    instants = [datetime(2026, 10, 25, 0, 59, 57, tzinfo=UTC) + timedelta(seconds=i) for i in range(6)]
    local = [i.astimezone(ZoneInfo("Europe/Paris")).strftime("%Y-%m-%d %H:%M:%S") for i in instants]
    made = timed({"source": "t", "zone": "Europe/Paris"}, t=local)
    assert made.channels["time_s"] == pytest.approx(np.arange(6.0), abs=1e-5)
    assert datetime.fromisoformat(made.metadata["started_at"]) == instants[0]


def test_date_time_and_offset_stand_apart() -> None:
    clock = [f"09:11:{s:02d}" for s in range(5)]
    made = timed({"date": "D", "time": "T", "offset": "O"}, D=["2026-05-02"] * 5, T=clock, O=["+02:00"] * 5)
    assert made.faults == []
    assert datetime.fromisoformat(made.metadata["started_at"]) == START
    numbers = timed(
        {"date": "D", "time": "T", "format": "%Y%m%d %H%M%S", "zone": "UTC"},
        D=[20260502.0] * 3,
        T=[71100.0, 71101.0, 71102.0],
    )
    assert numbers.faults == []
    assert datetime.fromisoformat(numbers.metadata["started_at"]) == START


def test_midnight_is_passed_with_and_without_a_date() -> None:
    clock = ["23:59:58", "23:59:59", "00:00:00", "00:00:01"]
    plain = timed({"source": "T"}, T=clock)
    assert plain.channels["time_s"] == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert "started_at" not in plain.metadata
    stuck = timed({"date": "D", "time": "T", "zone": "UTC"}, D=["2026-05-02"] * 4, T=clock)
    assert stuck.channels["time_s"] == pytest.approx([0.0, 1.0, 2.0, 3.0])
    moving = timed({"date": "D", "time": "T", "zone": "UTC"}, D=["2026-05-02"] * 2 + ["2026-05-03"] * 2, T=clock)
    assert moving.channels["time_s"] == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert any("midnight" in flag for flag in stuck.flags)
    assert not moving.flags


@pytest.mark.parametrize("begins", [0, 3, 9])
def test_repeats_of_a_coarse_clock_are_spread(begins: int) -> None:
    truth = np.arange(begins, begins + 50) / 10.0
    stamps = [f"07:11:{int(t):02d}" for t in truth]
    made = timed({"source": "T"}, T=stamps)
    assert made.channels["time_s"] - made.channels["time_s"][0] == pytest.approx(truth - truth[0], abs=1e-6)
    assert any("repeat 10 times" in flag for flag in made.flags)
    kept = timed({"source": "T", "repeats": "keep"}, T=stamps)
    assert len(np.unique(kept.channels["time_s"])) < 10


def test_a_single_repeated_row_is_left_to_the_repair() -> None:
    made = timed({"source": "T"}, T=["07:11:00", "07:11:01", "07:11:01", "07:11:02", "07:11:03"])
    assert list(made.channels["time_s"]) == [0.0, 1.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("form", "number"),
    [
        ("epoch_s", START.timestamp()),
        ("epoch_ms", START.timestamp() * 1000.0),
        ("excel_days", 46144.29930555556),
        ("matlab_days", 46144.29930555556 - 25569.0 + 719529.0),
    ],
)
def test_counts_are_instants(form: str, number: float) -> None:
    step = {"epoch_s": 1.0, "epoch_ms": 1e3}.get(form, 1.0 / 86400.0)
    made = timed({"source": "c", "format": form, "zone": "UTC"}, c=[number + i * step for i in range(5)])
    assert made.channels["time_s"] == pytest.approx(np.arange(5.0), abs=2e-4)
    assert abs((datetime.fromisoformat(made.metadata["started_at"]) - START).total_seconds()) < 1e-3


def test_what_cannot_be_told_of_an_instant_is_a_fault() -> None:
    assert "without a zone" in problems(timed({"source": "t"}, t=["2026-05-02 07:11:00"] * 3))
    assert "may be two dates" in problems(timed({"source": "t", "zone": "UTC"}, t=["05/02/2026 07:11:00"] * 3))
    assert "no instant" in problems(timed({"source": "t", "zone": "UTC"}, t=["soon", "2026-05-02 07:11:00", "x"]))
    assert "which the file has not" in problems(timed({"source": "u", "zone": "UTC"}, t=["x"] * 3))


def test_the_start_of_the_file_and_its_instants_are_compared() -> None:
    table = Table(columns(time_s=None), texts={"t": [(START + timedelta(seconds=i)).isoformat() for i in range(N)]})
    made = record({"time": {"source": "t"}}, table, metadata={"started_at": "2026-05-02T09:11:00Z"})
    assert datetime.fromisoformat(made.metadata["started_at"]) == START
    assert "starts at 2026-05-02T09:11:00Z" in made.flags[0]


def test_tables_with_instants_keep_their_distance() -> None:
    later = [(START + timedelta(seconds=10 + i)).isoformat() for i in range(N)]
    tables = (
        Table({"a": np.zeros(N)}, texts={"t": [(START + timedelta(seconds=i)).isoformat() for i in range(N)]}),
        Table({"b": np.zeros(N)}, texts={"t": later}),
    )
    made = mapped(RawFile({}, tables), ChannelMapping.model_validate({"time": {"source": "t"}}))
    assert made.tables[0].time is not None
    assert made.tables[1].time is not None
    assert made.tables[1].time[0] - made.tables[0].time[0] == pytest.approx(10.0)
    assert {table.start for table in made.tables} == {START}


@pytest.mark.parametrize(
    ("pattern", "name", "found"),
    [
        ("{aircraft}_{pump_serial}_{flight_id}", "F-ABCD_SN-1_77.csv", {"aircraft": "F-ABCD", "pump_serial": "SN-1", "flight_id": "77"}),
        ("{aircraft}_{*}_{flight_id}.csv", "x/y/F-1_hyd_2_F7.CSV", {"aircraft": "F-1", "flight_id": "2_F7"}),
        ("{aircraft:6}{position:2}", "F-ABCDLH.csv.gz", {"aircraft": "F-ABCD", "position": "LH"}),
        ("{aircraft}-{started_at:%Y%m%d-%H%M}", "F-A-20260502-0711.mf4", {"aircraft": "F-A", "started_at": "2026-05-02T07:11:00Z"}),
        ("{aircraft}_{flight_id}", "nothing.csv", None),
        ("REC{flight_id}", "rec0042", {"flight_id": "0042"}),
    ],
)  # fmt: skip
def test_metadata_come_from_the_name_of_the_file(pattern: str, name: str, found: dict[str, str] | None) -> None:
    assert NamePattern(pattern, "UTC").read(name) == found


def test_what_the_request_says_wins_over_the_name() -> None:
    pattern = NamePattern("{aircraft}_{flight_id}")
    assert named_by(pattern, "A_1.csv", {"aircraft": "B"}) == {"aircraft": "B", "flight_id": "1"}
    assert named_by(pattern, "nothing", {"aircraft": "B", "flight_id": "2"}) == {"aircraft": "B", "flight_id": "2"}
    with pytest.raises(Exception, match="file's name"):
        named_by(pattern, None, {"aircraft": "B"})


def test_every_part_says_what_it_did() -> None:
    account = Account()
    mapping = ChannelMapping.model_validate(
        {
            "channels": [{"source": "P", "channel": "case_pressure_bar", "unit": "psi"}],
            "constants": {"position": "LH"},
            "leave_out": ["spare*"],
        }
    )
    table = Table(columns(case_pressure_bar=None, P=np.full(N, 14.5037738), spare1=np.zeros(N)))
    mapped_record(RawFile({}, (table,)), mapping, account)
    said = dict(account.steps)
    assert said["channels.case_pressure_bar"] == "from P in psi: 50 samples, 1 to 1"
    assert "spare1" in said["leave_out"]
    assert "LH" in said["constants"]


OLD = {
    "channels": [{"source": "P", "channel": "case_pressure_bar", "unit": "psi", "scale": 1.0, "offset": 0.0, "pressure_reference": None}],
    "metadata": {"Tail": "aircraft"},
    "defaults": {"position": "LH"},
    "csv": {"delimiter": ";", "decimal": ",", "encoding": "cp1252"},
}  # fmt: skip


def test_a_stored_mapping_of_the_first_release_is_what_it_was() -> None:
    # records remember their mapping in their identity: not one field may come or go
    assert ChannelMapping.model_validate(OLD).document() == OLD


def test_a_document_keeps_all_that_it_says() -> None:
    full = {
        **OLD,
        "channels": [
            {"channel": "shaft_speed_rpm", "value": 4600.0},
            {"channel": "case_pressure_bar", "formula": "a-b"},
        ],
        "time": {"source": "utc", "zone": "UTC"},
        "csv": {"header_row": 3, "units_row": 2, "skip_rows": [1], "missing": ["-9999"]},
        "file_name": "{aircraft}_{flight_id}",
        "leave_out": ["x"],
        "tables": ["LH"],
        "constants": {"position": "LH"},
    }
    made = ChannelMapping.model_validate(full)
    assert ChannelMapping.model_validate(made.document()) == made


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ({"channels": [{"channel": "case_pressure_bar"}]}, "one of source, value, formula"),
        (
            {"channels": [{"channel": "case_pressure_bar", "source": "a", "value": 1.0}]},
            "one of source, value, formula",
        ),
        ({"channels": [{"channel": "time_s", "value": 1.0}]}, "time_s comes from"),
        ({"channels": [{"channel": "case_pressure_bar", "formula": "a.b"}]}, "formula"),
        ({"channels": [{"channel": "case_pressure_bar", "source": "a", "unit": "pis"}]}, "did you mean psi"),
        ({"time": {"source": "a", "zone": "Mars/Base"}}, "no zone"),
        ({"time": {"date": "a"}}, "time comes from"),
        ({"time": {"source": "a", "format": "iso"}}, "neither strptime's"),
        ({"time": {"source": "a"}, "channels": [{"channel": "time_s", "source": "t"}]}, "not from both"),
        ({"file_name": "{colour}"}, "cannot be read from a file's name"),
        ({"file_name": "{operator}"}, "cannot be read from a file's name"),
        ({"constants": {"operator": "x"}}, "operator cannot be a constant"),
        ({"csv": {"delimiter": ";", "decimal": ",", "thousands": ","}}, "mark of thousands"),
        ({"csv": {"no_header": True, "header_row": 2}}, "no header or a line"),
    ],
)
def test_a_mapping_that_makes_no_sense_is_refused_with_the_reason(bad: dict[str, Any], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        ChannelMapping.model_validate(bad)
