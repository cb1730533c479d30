"""What cannot be brought in: one clear line for each thing that is wrong, exit code 2, nothing written."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from drivers.files.imports.mapping import Source
from drivers.files.imports.read import read_raw
from drivers.files.imports.trouble import ImportTrouble

GOOD = "Time [s];Shaft command [rpm];Shaft speed [rpm]\n" + "".join(
    f"{k / 10:.1f};{20 + 10 * (k // 9 % 4)};{20 + 10 * ((k - 1) // 9 % 4)}\n" for k in range(1, 80))
HEAD = "format: topdress-import/1\ntime: {column: 'Time [s]', counts: s}\n"
SHAFT = "columns:\n  shaft_rpm: {from: 'Shaft speed [rpm]'%s}\n"


def lines_of(result: Result, folder: Path, before: set[Path]) -> list[str]:
    assert result.exit_code == 2, result.output
    assert set(folder.iterdir()) == before, "something was written"
    return result.output.splitlines()


@pytest.mark.parametrize(("content", "said"), [
    ("", "the file is empty"),
    ("a,b\nx,y\n", "no row of numbers"),
    ("1,2\n3,4\n5,6\n", "no header row: the first row is 1, 2"),
    ("Time [s],Shaft speed [rpm]\n", "no row of numbers"),
    ("Time [s],Shaft speed [rpm]\n" + "3,1\n2,1\n" * 20, "40 rows are not later than the rows before them"),
    ("when,what\n" + "".join(f"2026-03-01T08:00:{k:02d}Z,{k}.5\n" for k in range(40)), "no column was recognised"),
])
def test_a_file_that_is_no_log(content: str, said: str, written: Callable[..., Path], topdress: Callable[..., Result],
                               tmp_path: Path) -> None:
    path = written(content)
    before = set(tmp_path.iterdir())
    lines = lines_of(topdress("import", path, "--out", tmp_path / "out.csv"), tmp_path, before)
    assert any(said in line for line in lines), lines
    assert all(str(path) in line for line in lines)


@pytest.mark.parametrize("names", [None, ("x", "y")])
@pytest.mark.parametrize("title_rows", [2, 3, 4, 5, 6, 900])
def test_titles_up_to_the_end_leave_no_rows(title_rows: int, names: tuple[str, str] | None, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2\n" if names else "a,b\n1,2\n3,4\n")
    with pytest.raises(ImportTrouble, match=r"no row of numbers among the first [23] lines"):
        read_raw(path, Source(title_rows=title_rows, names=names))


@pytest.mark.parametrize(("text", "said"), [
    (HEAD + SHAFT % ", unit: km/h", "columns.shaft_rpm.unit km/h: allowed r/min, r/s, rad/s, deg/s"),
    (HEAD + SHAFT % ", unit: furlong", "unit furlong: not known"),
    (HEAD + SHAFT % ", unit: '%'", "unit %: allowed with full"),
    (HEAD + SHAFT % ", full: 3", "full 3: allowed with unit % only"),
    (HEAD + SHAFT % ", scale: 0", "scale 0: allowed is any other number"),
    (HEAD + SHAFT % ", valid: [5, 1]", "valid 5, 1: allowed the lowest before the highest"),
    (HEAD + SHAFT % ", sign: 2", "key columns.shaft_rpm.sign: value 2: allowed 1, -1"),
    (HEAD + SHAFT % ", constant: 3", "from, constant: allowed is one of them"),
    (HEAD + "columns: {shaft_rpn: {from: a}}\n", "did you mean shaft_rpm?"),
    (HEAD + "columns: {time_s: {from: a}}\n", "allowed is the key time"),
    (HEAD + "columns: {applied_rate_kg_ha: {from: a, unit: kg/h}}\n", "allowed with width_m"),
    (HEAD + SHAFT % "" + "workin: 3\n", "key workin: unknown key; did you mean working?"),
    (HEAD + SHAFT % "" + "working: {column: a}\n", "no condition: allowed are equals, above, below"),
    ("format: topdress-import/1\ntime: {column: a, counts: text, zone: Europe/Berln}\ncolumns: {}\n",
     "did you mean Europe/Berlin?"),
    ("format: topdress-import/1\ntime: {counts: rows}\ncolumns: {}\n", "allowed with step_s"),
])
def test_an_import_file_with_a_mistake(text: str, said: str, written: Callable[..., Path],
                                       topdress: Callable[..., Result], tmp_path: Path) -> None:
    source, mapping = written(GOOD), written(text, "m.yaml")
    before = set(tmp_path.iterdir())
    lines = lines_of(topdress("import", source, "--mapping", mapping, "--out", tmp_path / "out.csv"), tmp_path, before)
    assert len(lines) == 1 and said in lines[0] and str(mapping) in lines[0], lines
    checked = topdress("check", mapping)
    assert checked.exit_code == 2 and said in checked.output


@pytest.mark.parametrize(("text", "said"), [
    (HEAD + "columns: {shaft_rpm: {from: Shaft}}\n", "columns.shaft_rpm.from Shaft: no such column: allowed Time"),
    (HEAD.replace("Time [s]", "Tme [s]") + SHAFT % "", "time.column Tme [s]: no such column: allowed Time [s], "),
    (HEAD + SHAFT % "" + "working: {column: 'Shaft speed [rpm]', above: 900}\n", "never fulfils the condition"),
    ("format: topdress-import/1\ntime: {column: 'Time [s]'}\n" + SHAFT % "",
     "row 2: column Time [s]: value 0.1: allowed ISO 8601"),
    (HEAD + SHAFT % "" + "source: {encoding: utf-9}\n", "source.encoding utf-9: not known"),
    (HEAD + SHAFT % "" + "source: {kind: excel}\n", "not readable as a workbook"),
    (HEAD + SHAFT % "" + "source: {kind: isoxml}\n", "TASKDATA.XML"),
    (HEAD + SHAFT % "" + "source: {kind: parquet}\n", "not readable as Parquet"),
])
def test_an_import_file_that_does_not_fit(text: str, said: str, written: Callable[..., Path],
                                          topdress: Callable[..., Result], tmp_path: Path) -> None:
    source, mapping = written(GOOD), written(text, "m.yaml")
    before = set(tmp_path.iterdir())
    lines = lines_of(topdress("import", source, "--mapping", mapping, "--out", tmp_path / "out.csv"), tmp_path, before)
    assert len(lines) == 1 and said in lines[0] and str(source) in lines[0], lines


def test_words_among_numbers_are_said_with_their_row(written: Callable[..., Path], topdress: Callable[..., Result],
                                                     tmp_path: Path) -> None:
    few = GOOD.replace(";20\n", ";broken\n", 1)
    result = topdress("import", written(few), "--out", tmp_path / "out.csv")
    assert result.exit_code == 0
    assert "1 cell such as 'broken' in row 2 emptied: not a number" in result.output
    most = "Time [s];Shaft speed [rpm]\n" + "".join(f"{k};{'x' if k > 3 else 1}\n" for k in range(20))
    mapping = written(HEAD + SHAFT % "", "m.yaml")
    result = topdress("import", written(most, "b.csv"), "--mapping", mapping, "--out", tmp_path / "b-out.csv")
    assert result.exit_code == 2 and "row 6: column Shaft speed [rpm]: value x: allowed a number" in result.output
    assert not (tmp_path / "b-out.csv").exists()


def test_nothing_is_written_over(written: Callable[..., Path], topdress: Callable[..., Result], tmp_path: Path) -> None:
    source, mapping = written(GOOD), written(HEAD + SHAFT % "", "log.yaml")
    assert "and is read" in topdress("import", source, "--out", source, "--force").output
    beside = topdress("import", written(GOOD, "b.csv"), "--mapping", mapping, "--out", tmp_path / "log.csv",
                      "--force")
    assert beside.exit_code == 2 and "and is read" in beside.output      # its sidecar would be the import file
    assert "exists already" in topdress("import", source, "--guess", "--mapping", mapping).output
    out = tmp_path / "out.csv"
    out.write_text("mine\n")
    again = topdress("import", source, "--out", out)
    assert again.exit_code == 2 and "--force replaces it" in again.output
    assert topdress("import", source, "--out", out, "--force").exit_code == 0
    assert source.read_text() == GOOD and mapping.read_text() == HEAD + SHAFT % ""


@pytest.mark.parametrize("fails_at", [1, 2])
def test_a_full_disk_leaves_nothing(fails_at: int, written: Callable[..., Path], topdress: Callable[..., Result],
                                    tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers.files.imports import log_file
    source, whole, calls = written(GOOD), log_file.write_atomically, []

    def full(path: Path, content: str | bytes) -> None:
        calls.append(path)
        if len(calls) == fails_at:
            raise OSError(28, "No space left on device", str(path))
        whole(path, content)
    monkeypatch.setattr(log_file, "write_atomically", full)
    result = topdress("import", source, "--out", tmp_path / "out.csv")
    assert result.exit_code == 1 and "No space left on device" in result.output
    assert list(tmp_path.iterdir()) == [source]


def test_a_log_needs_a_place(written: Callable[..., Path], topdress: Callable[..., Result], tmp_path: Path) -> None:
    assert "no --out LOG.csv given" in topdress("import", written(GOOD)).output
    assert "ends in .csv" in topdress("import", written(GOOD), "--out", tmp_path / "x.txt").output
    gone = topdress("import", tmp_path / "gone.csv", "--out", tmp_path / "x.csv")
    assert gone.exit_code == 2 and "no such file" in gone.output
