"""What a foreign file looks like is said, with what to do about it; what lies beside records is listed."""

import bz2
import gzip
import io
import json
import lzma
import struct
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from typer.testing import CliRunner

from service.command_line.main import app
from service.errors import Undecodable
from service.ingest.file_formats import FORMATS
from service.ingest.looks import foreign_look
from service.ingest.parse import parsed
from service.ingest.raw import Limits
from service.ingest.upload_files import files_of, passed_over
from tests.service.records import body

LIMITS = Limits(10_000_000, 100_000)
CSV = b"# pump_serial: P-1\ntime_s,case_pressure_bar\n0,0.5\n1,0.5\n"


def zipped(*names: str) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            archive.writestr(name, "<x/>" * 50)
    return out.getvalue()


def tarred() -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("a.csv"), io.BytesIO())
    return out.getvalue()


def matlab_4() -> bytes:
    out = io.BytesIO()
    scipy.io.savemat(out, {"time_s": np.arange(5.0)}, format="4")
    return out.getvalue()


def array() -> bytes:
    out = io.BytesIO()
    np.save(out, np.arange(3.0))
    return out.getvalue()


FOREIGN: dict[str, tuple[bytes, str]] = {
    "mdf 3": (b"MDF     3.30    casedrain" + bytes(200), "MDF 3"),
    "matlab 4": (matlab_4(), "MATLAB 4"),
    "matlab 4 of a big machine": (struct.pack(">5i", 1000, 5, 1, 0, 7) + b"time_s\x00" + bytes(40), "MATLAB 4"),
    "xlsx": (zipped("[Content_Types].xml", "_rels/.rels", "xl/workbook.xml"), "Excel workbook"),
    "xls": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(500), "Excel 97"),
    "zip": (zipped("a.csv", "b.csv"), "ZIP archive"),
    "pdf": (b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n1 0 obj\x00", "PDF"),
    "png": (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "PNG"),
    "web page": (b"<!DOCTYPE html>\n<html><head><title>Sign in</title>", "web page"),
    "xml": (b"<?xml version='1.0'?><log/>", "XML"),
    "tar": (tarred(), "tar archive"),
    "bzip2": (bz2.compress(CSV), "bzip2"),
    "xz": (lzma.compress(CSV), "xz"),
    "7z": (b"7z\xbc\xaf\x27\x1c\x00\x04" + bytes(40), "7-Zip"),
    "sqlite": (b"SQLite format 3\x00" + bytes(100), "SQLite"),
    "netcdf 3": (b"CDF\x01\x00\x00\x00\x00" + bytes(40), "NetCDF 3"),
    "numpy": (array(), "NumPy"),
    "chapter 10": (b"\x25\xeb\x00\x00" + bytes(40), "IRIG 106"),
}


@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.parametrize("sent", ["application/octet-stream", "text/csv", "application/x-hdf5", "application/gzip"])
def test_what_it_looks_like_and_what_to_do_is_said(kind: str, sent: str) -> None:
    content, name = FOREIGN[kind]
    content = gzip.compress(content) if sent == "application/gzip" else content
    with pytest.raises(Undecodable) as refused:
        parsed(content, sent, "", LIMITS)
    assert name in refused.value.detail
    assert name in refused.value.errors[0].problem
    assert len(refused.value.errors) == 1


def test_one_of_ours_under_another_type_is_said_to_be_that() -> None:
    for content, sent, words in (
        (b"PAR1" + bytes(50), "text/csv", "looks like Parquet, not like CSV"),
        (b"TDSm" + bytes(50), "application/x-mdf4", "looks like TDMS, not like MDF4"),
        (b"\x89HDF\r\n\x1a\n" + bytes(50), "application/json", "looks like HDF5, not like JSON"),
        (gzip.compress(CSV), "text/csv", "looks like gzip, not like CSV"),
        (gzip.compress(gzip.compress(CSV)), "application/gzip", "looks like gzip inside gzip"),
    ):
        with pytest.raises(Undecodable, match=words):
            parsed(content, sent, "", LIMITS)


@pytest.mark.parametrize(
    "content",
    [
        CSV,
        b"MZ,ORC,BZh,RIFF\n1,2,3,4\n",
        b"\xef\xbb\xbftime_s,Obj\n0,1\n",
        "time_s,Öltemperatur\n0,1\n".encode("latin-1"),
        body(),
        json.dumps({"a": "<html>"}).encode(),
        b"",
        bytes(100),
        bytes(range(256)),
    ],
)
def test_a_table_is_not_taken_for_anything(content: bytes) -> None:
    assert foreign_look(content) is None


def test_no_format_of_ours_looks_foreign() -> None:
    for file_format in FORMATS:
        for mark in file_format.marks:
            assert foreign_look(mark + bytes(200)) is None


def test_what_is_passed_over_is_listed_with_the_reason(tmp_path: Path) -> None:
    inside = tmp_path / "day" / "inside"
    inside.mkdir(parents=True)
    (inside / "good.csv").write_bytes(CSV)
    (tmp_path / "day" / "sheet.xlsx").write_bytes(FOREIGN["xlsx"][0])
    (tmp_path / "day" / "old.mdf").write_bytes(FOREIGN["mdf 3"][0])
    (inside / "table.parq").write_bytes(b"PAR1" + bytes(20))
    (inside / "notes.txt").write_text("windy")
    (inside / "empty.dat").write_bytes(b"")
    found = {path.name: why for path, why in passed_over([str(tmp_path)])}
    assert set(found) == {"sheet.xlsx", "old.mdf", "table.parq", "notes.txt", "empty.dat"}
    assert "save the sheet as CSV" in found["sheet.xlsx"]
    assert "MDF 4" in found["old.mdf"]
    assert "name it table.parquet" in found["table.parq"]
    assert found["empty.dat"] == "is empty"
    assert [p.name for p in files_of([str(tmp_path)])[0]] == ["good.csv"]
    assert passed_over([str(inside / "notes.txt")]) == []
    (inside / "good.csv").unlink()
    ran = CliRunner().invoke(app, ["upload", str(tmp_path)])
    assert ran.exit_code == 2
    assert "save the sheet as CSV" in ran.output
    for n in range(30):
        (inside / f"{n}.log").write_text("x")
    assert "15 more files passed over" in CliRunner().invoke(app, ["upload", str(tmp_path)]).output
