"""Text tables as exports write them: quick and careful reader agree bit for bit, and what is foreign refuses nothing."""

import gzip
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from service.errors import Problem, TooLarge, Undecodable
from service.ingest.csv_cells import columns_by_cell
from service.ingest.csv_columnar import columns_at_once
from service.ingest.csv_format import parsed
from service.ingest.csv_layout import layout_of
from service.ingest.csv_words import Words, numbers_of
from service.ingest.decode import checked
from service.ingest.parse import parsed as parsed_by_type
from service.ingest.raw import MOST_COLUMNS, Limits, RawFile, Table, TextDialect
from tests.service.records import METADATA

LIMITS = Limits(50_000_000, 100_000)
HEADER = "".join(f"# {k}: {v}\n" for k, v in METADATA.items())
NUMBERS = (
    st.floats(width=64).map(repr)
    | st.integers(-(10**25), 10**25).map(str)
    | st.decimals(-1000, 1000, places=4).map(str)
    | st.sampled_from(["", "NaN", "N/A", "-", "null", " 1 ", "1e400", "-0", "+3", ".5", "5.", "1E5", "1.#QNAN", "inf"])
)
WORDS = st.sampled_from(["GROUND", "on", "2026-05-02 07:11:00", "0x10", "1_000", "true", "1,5", "é", "nan(7)", "12 V"])


def read(text: str | bytes, **dialect: Any) -> RawFile:
    return parsed(text if isinstance(text, bytes) else text.encode(), LIMITS, TextDialect(**dialect))


def table(text: str | bytes, **dialect: Any) -> Table:
    file = read(text, **dialect)
    assert not file.faults
    return file.tables[0]


def problems(file: RawFile) -> dict[str, str]:
    return {fault.where: fault.problem for fault in file.faults}


@settings(max_examples=50, deadline=None)
@given(
    rows=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS | WORDS, WORDS), min_size=1, max_size=8),
    line_end=st.sampled_from(["\n", "\r\n", "\r"]),
    delimiter=st.sampled_from([",", ";", "\t", "|"]),
    decimal=st.sampled_from([".", ","]),
    is_quoted=st.booleans(),
)
@example([("1", "2", "3", "x"), ("nan(7)", "2", "x", "x")], "\n", ",", ".", False)
def test_both_readers_agree_bit_for_bit(
    rows: Any, line_end: str, delimiter: str, decimal: str, is_quoted: bool
) -> None:
    def cell(word: str) -> str:
        word = word.replace(".", decimal)
        return f'"{word}"' if is_quoted or delimiter in word else word

    lines = [delimiter.join(("time_s", "speed", "either", "phase"))]
    lines += [delimiter.join(cell(word) for word in row) for row in rows]
    layout = layout_of((line_end.join(lines) + line_end).encode(), TextDialect(delimiter, decimal))
    quick, careful = columns_at_once(layout), columns_by_cell(layout)
    if quick is None:
        return  # the careful reader has the word
    assert not careful.faults
    assert quick.texts == careful.texts
    assert quick.numbers.keys() == careful.numbers.keys()
    for i, samples in quick.numbers.items():
        assert samples.tobytes() == careful.numbers[i].tobytes() or np.array_equal(
            samples, careful.numbers[i], equal_nan=True
        )


def test_faultless_files_take_the_quick_way() -> None:
    """Else a change could send every file through the careful reader, and only a benchmark would know."""
    for text in (
        "time_s,x,phase\n0,1.5,a\n1,,b\n2,N/A,\n",
        "time_s,x,phase\r\n0,1.5,\r\n1,-,b\r\n",
        'time_s,x\n"0","1"\n',
        "time_s,x,mixed\n0,1,2\n1,1,ERR\n",
    ):
        assert columns_at_once(layout_of(text.encode(), TextDialect())) is not None, text
    for text in ("time_s,x\n0,1\n1\n", "time_s,x\nzero,1\n"):
        assert columns_at_once(layout_of(text.encode(), TextDialect())) is None, text


def test_foreign_words_refuse_nothing_and_ours_are_faults() -> None:
    file = read("time_s,phase,mixed,case_pressure_bar\n0,GROUND,1,0.5\n1,FLIGHT,ERR,0.5\n2,,3,x\n")
    assert problems(file) == {"line 4, case_pressure_bar": "'x' is not a number"}
    assert file.tables[0].texts == {"phase": ["GROUND", "FLIGHT", None], "mixed": ["1", "ERR", "3"]}
    samples, faults = numbers_of("mixed", file.tables[0].texts["mixed"])
    assert np.array_equal(samples, [1.0, np.nan, 3.0], equal_nan=True)
    assert [(f.where, f.problem) for f in faults] == [("channels.mixed[1]", "'ERR' is not a number")]


@pytest.mark.parametrize(
    "word",
    [
        "",
        "N/A",
        "#N/A",
        "NA",
        "n/a",
        "-",
        "--",
        "null",
        "NULL",
        "NaN",
        "nan",
        "none",
        "1.#QNAN",
        "-1.#IND",
        " NaN ",
        '""',
    ],
)
def test_usual_words_for_missing_samples(word: str) -> None:
    found = table(f"time_s,case_pressure_bar,x\n0,1,2\n1,{word},{word}\n2,3,4\n").channels
    assert np.array_equal(found["case_pressure_bar"], [1.0, np.nan, 3.0], equal_nan=True)
    assert np.array_equal(found["x"], [2.0, np.nan, 4.0], equal_nan=True)


def test_a_number_is_missing_only_where_the_dialect_says_so() -> None:
    text = "time_s,x\n0,-9999.0\n1,5\n2,off\n"
    assert table(text).texts["x"] == ["-9999.0", "5", "off"]
    found = table(text, missing=("-9999", "off")).channels["x"]
    assert np.array_equal(found, [np.nan, 5.0, np.nan], equal_nan=True)
    assert table("time_s,x\n0,-9999\n").channels["x"][0] == -9999.0


def test_marks_of_thousands_are_held_to_groups() -> None:
    found = table("time_s;x\n0;1.234.567,5\n1;12,25\n", delimiter=";", decimal=",", thousands=".")
    assert list(found.channels["x"]) == [1234567.5, 12.25]
    for blank in " \u00a0\u2009\u202f":
        text = f"time_s;x\n0;1{blank}234{blank}567,5\n1;12,25\n"
        assert list(table(text, delimiter=";", decimal=",", thousands=" ").channels["x"]) == [1234567.5, 12.25]
    assert Words(thousands="'").number("4\u2019592.5") == 4592.5
    file = read("time_s;case_pressure_bar\n0;1.23\n", delimiter=";", decimal=",")
    assert "is not a number" in problems(file)["line 2, case_pressure_bar"]
    with pytest.raises(ValueError, match="12,34"):
        Words(thousands=",").number("12,34")


def test_a_header_of_ours_is_read_with_the_marks_it_has() -> None:
    semicolons = table("time_s;case_pressure_bar\n0;0,9\n1;0,95\n")
    assert list(semicolons.channels["case_pressure_bar"]) == [0.9, 0.95]
    assert list(table("time_s\tcase_pressure_bar\n0\t0.9\n").channels["case_pressure_bar"]) == [0.9]
    assert list(table("sep=;\ntime_s;case_pressure_bar\n0;0.9\n").channels["case_pressure_bar"]) == [0.9]
    with pytest.raises(Undecodable, match="not separated by commas"):
        read("Zeit;Druck\n0;0,9\n")


def test_line_ends_marks_blank_lines_and_trailing_delimiters() -> None:
    plain = table("time_s,x\n0,1\n1,2\n").channels
    for text in (
        "\ufefftime_s,x\n0,1\n1,2\n",
        "time_s,x\r\n0,1\r\n1,2\r\n",
        "time_s,x\r0,1\r1,2\r",
        "\n\ntime_s,x\n\n0,1\n   \n1,2\n\n",
        "time_s,x,\n0,1,\n1,2,\n",
        "time_s,x\n0,1,\n1,2,\n",
        "time_s,x,\n0,1\n1,2\n",
        '"time_s","x"\n"0","1"\n"1","2"\n',
        "time_s, x \n 0, 1\n 1, 2\n",
        "time_s,x\n0,1\n# a remark, in between\n1,2\n",
        "time_s,x\n0,1\n1,2",
    ):
        found = table(text).channels
        assert {name: list(samples) for name, samples in found.items()} == {
            name: list(samples) for name, samples in plain.items()
        }, text


def test_a_last_line_that_was_cut_is_left_out_and_flagged() -> None:
    whole = "time_s,case_pressure_bar,x\n0,1,2\n1,2,3\n"
    for cut in ("2,3", "2,", "2", "2,3,-1e", "é,3"):
        file = read(whole + cut)
        assert not file.faults, cut
        assert file.flags == ["the last line is cut: left out"], cut
        assert list(file.tables[0].channels["time_s"]) == [0.0, 1.0]
    half_a_letter = (whole + "2,3,é").encode()[:-1]
    assert read(half_a_letter).flags == ["the last line is cut: left out"]
    padded = read(whole.encode() + b"2,3" + bytes(100))
    assert padded.flags == ["100 zero bytes at the end of the file left out", "the last line is cut: left out"]
    assert "has 2 fields" in problems(read(whole + "2,3\n"))["line 4"]


def test_the_header_again_is_left_out_and_flagged() -> None:
    """A recorder that starts anew writes it again; a line that is nearly the header is a fault as before."""
    head, rows = "time_s,case_pressure_bar,mode", ["0,0.5,on", "1,0.6,on", "2,0.7,off"]
    file = read("\n".join([head, rows[0], " time_s , case_pressure_bar,mode", rows[1], head, rows[2]]) + "\n")
    (found,) = file.tables
    assert not file.faults
    assert found.channels["case_pressure_bar"].tolist() == [0.5, 0.6, 0.7]
    assert found.texts["mode"] == ["on", "on", "off"]
    assert file.flags == ["the header again on 2 line(s), first on line 3: left out"]
    other = read("\n".join([head, rows[0], "time_s,reservoir_pressure_bar,mode", rows[1]]) + "\n")
    assert len(other.faults) == 2
    assert not other.flags


def test_a_gzip_stream_that_was_cut_keeps_its_whole_lines() -> None:
    rng = np.random.default_rng(1)
    rows = [f"{i},{rng.normal():.6f}" for i in range(5000)]
    content = gzip.compress(("time_s,x\n" + "\n".join(rows) + "\n").encode())
    file = parsed_by_type(content[: len(content) // 2], "application/gzip", "", LIMITS)
    n = len(file.tables[0].channels["time_s"])
    assert 1000 < n < 4000
    assert list(file.tables[0].channels["x"]) == [float(row.split(",")[1]) for row in rows[:n]]
    assert file.flags[0].startswith("the gzip stream is cut")
    damaged = bytearray(content)
    damaged[len(content) // 2] ^= 0xFF
    with pytest.raises(Undecodable):
        parsed_by_type(bytes(damaged), "application/gzip", "", LIMITS)


def test_header_units_and_lines_by_number() -> None:
    log = '#airframe, version="1.00"\n#s, psi, enum\n  Time, HYD1 P, Phase\n   0, 103, GND\n   1, 104, GND\n'
    found = table(log, header_row=3, units_row=2)
    assert found.units == {"Time": "s", "HYD1 P": "psi", "Phase": "enum"}
    assert list(found.channels["HYD1 P"]) == [103.0, 104.0]
    assert found.texts == {"Phase": ["GND", "GND"]}
    under = "Tail,F-7\nLogger: X\n\nTime,Press\ns,bar\n0,1\n1,2\nsum,3\nend\n"
    file = read(under, header_row=4, units_row=5, footer_rows=2)
    assert file.metadata == {"Tail": "F-7", "Logger": "X"}
    assert file.tables[0].units == {"Time": "s", "Press": "bar"}
    assert list(file.tables[0].channels["Press"]) == [1.0, 2.0]
    two = table("Pump,,Case\nspeed,flow,p\n1,2,3\n", header_rows=2)
    assert list(two.channels) == ["Pump speed", "flow", "Case p"]
    assert list(table("t,x\n0,1\nbad\n2,3\n", skip_rows=(3,)).channels["t"]) == [0.0, 2.0]


def test_no_header_and_blanks_between_fields() -> None:
    text = "% written by the rig\n  0.0   1.5\t2\n  0.1   1.6   3\n"
    found = table(text, delimiter=" ", comment="%", no_header=True, names=("t", "p", "n"))
    assert {name: list(samples) for name, samples in found.channels.items()} == {
        "t": [0.0, 0.1],
        "p": [1.5, 1.6],
        "n": [2.0, 3.0],
    }
    assert list(table("0,1\n1,2\n", no_header=True).channels) == ["1", "2"]


def test_a_row_of_units_is_recognised_among_faults() -> None:
    file = read("time_s,case_pressure_bar,x\ns,bar,rpm\n0,1,2\n1,1,2\n")
    assert "units_row" in problems(file)["line 2"]


def test_names_that_repeat_or_are_missing() -> None:
    file = read("time_s,p,p,,time_s\n0,1,2,3,4\n")
    assert problems(file) == {"line 1": "column 'time_s' appears twice"}
    assert list(file.tables[0].channels)[:3] == ["time_s", "p", "p (2)"]
    assert file.not_kept == {"column 4": "has no name"}


def test_faults_name_lines_of_the_file() -> None:
    file = read('# a: b\n\ntime_s,case_pressure_bar,x\n0,1,"two\nlines"\n\n1,bad,z\n')
    assert list(problems(file)) == ["line 7, case_pressure_bar"]


def test_too_many_columns_are_refused() -> None:
    with pytest.raises(TooLarge, match="columns"):
        read(",".join(f"c{i}" for i in range(MOST_COLUMNS + 1)) + "\n")


@settings(max_examples=120, deadline=None)
@given(
    text=st.text(st.sampled_from('0123456789.,;"\n\r\t #:-eNaé\0'), max_size=80),
    dialect=st.builds(
        TextDialect,
        delimiter=st.sampled_from([",", ";", "\t", " "]),
        decimal=st.sampled_from([".", ","]),
        thousands=st.sampled_from(["", ",", "'"]),
        header_row=st.none() | st.integers(1, 4),
        header_rows=st.integers(1, 2),
        no_header=st.booleans(),
        names=st.sampled_from([(), ("a", "b")]),
        units_row=st.none() | st.integers(1, 4),
        skip_rows=st.lists(st.integers(1, 5), max_size=2).map(tuple),
        comment=st.sampled_from(["#", "", "//"]),
        footer_rows=st.integers(0, 2),
        missing=st.sampled_from([(), ("-9999", "off")]),
    ),
)
def test_any_text_in_any_dialect_is_a_table_or_a_problem(text: str, dialect: TextDialect) -> None:
    try:
        file = parsed(text.encode(), LIMITS, dialect)
    except Problem as problem:
        assert problem.status < 500  # noqa: PT017 - either way is right
        return
    lengths = {len(c) for t in file.tables for c in (*t.channels.values(), *t.texts.values())}
    assert len(lengths) <= 1


def test_a_record_with_words_is_stored_with_what_it_cannot_hold_named() -> None:
    rows = "".join(f"{i / 10},{170 + i % 2},1,{4600 + i % 3},50,GROUND\n" for i in range(300))
    names = "time_s,discharge_pressure_bar,case_pressure_bar,shaft_speed_rpm,fluid_temperature_degc,phase\n"
    record = checked(read(HEADER + names + rows), {})
    assert "phase" in record.recording.attributes["not_kept"]
