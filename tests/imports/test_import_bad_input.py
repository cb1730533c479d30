"""What cannot be brought in: one clear line for each thing that is wrong, exit code 2, nothing
written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import Result
from topdress.drivers.files.imports.import_errors import LogImportError
from topdress.drivers.files.imports.mapping import Source
from topdress.drivers.files.imports.table_reader import read_raw_table
from topdress.drivers.files.read_log import read_log

GOOD = "Time [s];Shaft command [rpm];Shaft speed [rpm]\n" + "".join(
    f"{k / 10:.1f};{20 + 10 * (k // 9 % 4)};{20 + 10 * ((k - 1) // 9 % 4)}\n" for k in range(1, 80)
)
HEAD = "format: topdress-import/1\ntime: {column: 'Time [s]', counts: s}\n"
SHAFT = "columns:\n  shaft_rpm: {from: 'Shaft speed [rpm]'%s}\n"


def lines_of(result: Result, folder: Path, before: set[Path]) -> list[str]:
    assert result.exit_code == 2, result.output
    assert set(folder.iterdir()) == before, "something was written"
    return result.output.splitlines()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "the file is empty"),
        ("a,b\nx,y\n", "no row of numbers"),
        ("1,2\n3,4\n5,6\n", "no header row: the first row is 1, 2"),
        ("Time [s],Shaft speed [rpm]\n", "no row of numbers"),
        (
            "Time [s],Shaft speed [rpm]\n" + "3,1\n2,1\n" * 20,
            "40 rows are not later than the rows before them",
        ),
        (
            "when,what\n" + "".join(f"2026-03-01T08:00:{k:02d}Z,{k}.5\n" for k in range(40)),
            "no column was recognised",
        ),
    ],
)
def test_a_file_that_is_no_log(
    content: str,
    said: str,
    written: Callable[..., Path],
    topdress: Callable[..., Result],
    tmp_path: Path,
) -> None:
    path = written(content)
    before = set(tmp_path.iterdir())
    lines = lines_of(topdress("import", path, "--out", tmp_path / "out.csv"), tmp_path, before)
    assert any(said in line for line in lines), lines
    assert all(str(path) in line for line in lines)


@pytest.mark.parametrize("names", [None, ("x", "y")])
@pytest.mark.parametrize("title_rows", [2, 3, 4, 5, 6, 900])
def test_titles_up_to_the_end_leave_no_rows(
    title_rows: int, names: tuple[str, str] | None, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2\n" if names else "a,b\n1,2\n3,4\n")
    with pytest.raises(LogImportError, match=r"no row of numbers among the first [23] lines"):
        read_raw_table(path, Source(title_rows=title_rows, names=names))


MISTAKES = [
    (
        HEAD + SHAFT % ", unit: km/h",
        "columns.shaft_rpm.unit km/h: allowed r/min, r/s, rad/s, deg/s",
    ),
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
    (
        HEAD + SHAFT % "" + "working: {column: a}\n",
        "no condition: allowed are equals, above, below",
    ),
    (
        "format: topdress-import/1\ntime: {column: a, counts: text, zone: "
        "Europe/Berln}\ncolumns: {}\n",
        "did you mean Europe/Berlin?",
    ),
    ("format: topdress-import/1\ntime: {counts: rows}\ncolumns: {}\n", "allowed with step_s"),
]
UNFIT = [
    (
        HEAD + "columns: {shaft_rpm: {from: Shaft}}\n",
        "columns.shaft_rpm.from Shaft: no such column: allowed Time",
    ),
    (
        HEAD.replace("Time [s]", "Tme [s]") + SHAFT % "",
        "time.column Tme [s]: no such column: allowed Time [s], ",
    ),
    (
        HEAD + SHAFT % "" + "working: {column: 'Shaft speed [rpm]', above: 900}\n",
        "never fulfils the condition",
    ),
    (
        "format: topdress-import/1\ntime: {column: 'Time [s]'}\n" + SHAFT % "",
        "row 2: column Time [s]: value 0.1: allowed ISO 8601",
    ),
    (HEAD + SHAFT % "" + "source: {encoding: utf-9}\n", "source.encoding utf-9: not known"),
    (HEAD + SHAFT % "" + "source: {kind: excel}\n", "not readable as a workbook"),
    (HEAD + SHAFT % "" + "source: {kind: isoxml}\n", "TASKDATA.XML"),
    (HEAD + SHAFT % "" + "source: {kind: parquet}\n", "not readable as Parquet"),
]


@pytest.mark.parametrize(
    ("text", "said", "in_mapping"),
    [*((*one, True) for one in MISTAKES), *((*one, False) for one in UNFIT)],
)
def test_an_import_file_with_a_mistake_or_that_does_not_fit(
    text: str,
    said: str,
    in_mapping: bool,
    written: Callable[..., Path],
    topdress: Callable[..., Result],
    tmp_path: Path,
) -> None:
    source, mapping = written(GOOD), written(text, "m.yaml")
    before = set(tmp_path.iterdir())
    lines = lines_of(
        topdress("import", source, "--mapping", mapping, "--out", tmp_path / "out.csv"),
        tmp_path,
        before,
    )
    assert (
        len(lines) == 1 and said in lines[0] and str(mapping if in_mapping else source) in lines[0]
    ), lines
    if in_mapping:
        checked = topdress("check", mapping)
        assert checked.exit_code == 2 and said in checked.output


def test_words_among_numbers_are_said_with_their_row(
    written: Callable[..., Path], topdress: Callable[..., Result], tmp_path: Path
) -> None:
    few = GOOD.replace(";20\n", ";broken\n", 1)
    result = topdress("import", written(few), "--out", tmp_path / "out.csv")
    assert result.exit_code == 0
    assert "1 cell such as 'broken' in row 2 emptied: not a number" in result.output
    most = "Time [s];Shaft speed [rpm]\n" + "".join(
        f"{k};{'x' if k > 3 else 1}\n" for k in range(20)
    )
    mapping = written(HEAD + SHAFT % "", "m.yaml")
    result = topdress(
        "import", written(most, "b.csv"), "--mapping", mapping, "--out", tmp_path / "b-out.csv"
    )
    assert (
        result.exit_code == 2
        and "row 6: column Shaft speed [rpm]: value x: allowed a number" in result.output
    )
    assert not (tmp_path / "b-out.csv").exists()


def test_nothing_is_written_over(
    written: Callable[..., Path], topdress: Callable[..., Result], tmp_path: Path
) -> None:
    source, mapping = written(GOOD), written(HEAD + SHAFT % "", "log.yaml")
    assert "and is read" in topdress("import", source, "--out", source, "--force").output
    beside = topdress(
        "import",
        written(GOOD, "b.csv"),
        "--mapping",
        mapping,
        "--out",
        tmp_path / "log.csv",
        "--force",
    )
    # its sidecar would be the import file
    assert beside.exit_code == 2 and "and is read" in beside.output
    assert "exists already" in topdress("import", source, "--guess", "--mapping", mapping).output
    out = tmp_path / "out.csv"
    out.write_text("mine\n")
    again = topdress("import", source, "--out", out)
    assert again.exit_code == 2 and "--force replaces it" in again.output
    assert topdress("import", source, "--out", out, "--force").exit_code == 0
    assert source.read_text() == GOOD and mapping.read_text() == HEAD + SHAFT % ""


@pytest.mark.parametrize("fails_at", [1, 2])
def test_a_full_disk_leaves_nothing(
    fails_at: int,
    written: Callable[..., Path],
    topdress: Callable[..., Result],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from topdress.drivers.files.imports import log_file

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


def test_a_log_needs_a_place(
    written: Callable[..., Path], topdress: Callable[..., Result], tmp_path: Path
) -> None:
    assert "no --out LOG.csv given" in topdress("import", written(GOOD)).output
    assert "ends in .csv" in topdress("import", written(GOOD), "--out", tmp_path / "x.txt").output
    gone = topdress("import", tmp_path / "gone.csv", "--out", tmp_path / "x.csv")
    assert gone.exit_code == 2 and "no such file" in gone.output


# --- What a stranger's file does not say is asked: headers, units of another scale, rows that
# cannot be so fa... -----

Topdress = Callable[..., Result]
RNG = np.random.default_rng(4)


def driven(rows: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Duty cycle in %, held for 40 rows, both directions, and the speed in rad/s a row later."""
    duty = np.repeat(RNG.uniform(-80.0, 80.0, rows // 40).round(1), 40)
    return duty, np.concatenate(([0.0], 1.8 * duty[:-1])) + 0.2 * RNG.standard_normal(rows)


def written(path: Path, head: str, *columns: np.ndarray) -> Path:
    lines = [",".join(f"{value:g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*([head] if head else []), *lines]) + "\n")
    return path


def test_a_file_without_a_header_is_guessed_with_names_to_fill_in(
    topdress: Topdress, tmp_path: Path
) -> None:
    raw, place, out = (
        written(tmp_path / "raw.csv", "", *driven()),
        tmp_path / "m.yaml",
        tmp_path / "log.csv",
    )
    refused = topdress("diagnose", raw)
    assert refused.exit_code == 2 and "no header row" in refused.output and not out.exists()
    assert (
        topdress("import", raw, "--guess", "--mapping", place, "--machine", "drive_alone").exit_code
        == 0
    )
    text = place.read_text(encoding="utf-8")
    assert yaml.safe_load(text)["source"]["names"] == ["c1", "c2"]
    assert "c2 follows c1: is that the command of a drive" in text
    for line in ('shaft_rpm_cmd: {from: "c1", scale: 6.5}', 'shaft_rpm: {from: "c2", unit: rad/s}'):
        assert f"# {line}" in text
        text = text.replace(f"# {line}", line)
    place.write_text(text.replace("step_s: 1.0", "step_s: 0.005"), encoding="utf-8")
    done = topdress("import", raw, "--mapping", place, "--out", out)
    assert done.exit_code == 0, done.output
    log = read_log(out)
    assert log.time_s[-1] == pytest.approx(0.005 * 399)
    assert np.nanmax(np.abs(log.numbers("shaft_rpm"))) > 1000.0


def test_what_a_full_command_is_comes_from_the_machine_file(
    topdress: Topdress, tmp_path: Path
) -> None:
    duty, speed = driven()
    raw = written(
        tmp_path / "raw.csv",
        "time [s],motor command [%],motor speed actual [rad/s]",
        0.01 * np.arange(400),
        duty,
        speed,
    )
    out = tmp_path / "log.csv"
    asked = topdress("import", raw, "--out", out)
    assert asked.exit_code == 2 and "100 % is in r/min" in asked.output
    done = topdress("import", raw, "--out", out, "--machine", "drive_alone")
    assert done.exit_code == 0, done.output
    assert np.allclose(read_log(out).numbers("shaft_rpm_cmd"), 6.5 * duty, atol=0.06)


def test_rates_as_a_volume_ask_for_the_density(topdress: Topdress, tmp_path: Path) -> None:
    target = np.repeat([150.0, 200.0, 120.0, 180.0], 50)
    raw = written(
        tmp_path / "spray.csv",
        "time [s],Target rate (L/ha),Applied rate (L/ha)",
        np.arange(200.0),
        target,
        0.97 * target,
    )
    place, out = tmp_path / "m.yaml", tmp_path / "log.csv"
    asked = topdress("import", raw, "--guess", "--mapping", place)
    assert asked.output.count("density_kg_l") == 2
    said = yaml.safe_load(place.read_text(encoding="utf-8"))
    said["columns"] = {
        "target_rate_kg_ha": {"from": "Target rate (L/ha)", "unit": "l/ha"},
        "applied_rate_kg_ha": {"from": "Applied rate (L/ha)", "unit": "l/ha"},
    }
    place.write_text(yaml.safe_dump(said), encoding="utf-8")
    refused = topdress("import", raw, "--mapping", place, "--out", out)
    assert (
        refused.exit_code == 2
        and "allowed with density_kg_l" in refused.output
        and not out.exists()
    )
    place.write_text(yaml.safe_dump(said | {"density_kg_l": 1.28}), encoding="utf-8")
    assert topdress("import", raw, "--mapping", place, "--out", out).exit_code == 0
    assert np.allclose(read_log(out).numbers("target_rate_kg_ha"), 1.28 * target)


@pytest.mark.parametrize(("step", "asked"), [(1000.0, True), (1.0, False), (1e-6, True)])
def test_rows_that_cannot_be_so_far_apart_are_asked(
    topdress: Topdress, tmp_path: Path, step: float, asked: bool
) -> None:
    raw = written(
        tmp_path / "raw.csv",
        "time [s],shaft speed [rpm],opening [mm]",
        step * np.arange(103.0),
        50.0 + np.arange(103.0) % 7,
        20.0 + np.arange(103.0) % 3,
    )
    done = topdress("import", raw, "--out", tmp_path / "log.csv")
    assert ("are the times in another unit?" in done.output) == asked
    assert not asked or "for 103 rows" in done.output


def test_points_without_times_are_not_timed_by_their_longitude(
    topdress: Topdress, tmp_path: Path
) -> None:
    raw = written(
        tmp_path / "points.csv",
        "lat_deg,lon_deg,Target rate (kg/ha),Applied rate (kg/ha)",
        np.full(100, 50.0),
        10.0 + 1e-4 * np.arange(100.0),
        100.0 + np.arange(100.0) % 9,
        98.0 + np.arange(100.0) % 9,
    )
    asked = topdress("import", raw, "--out", tmp_path / "log.csv")
    assert "lon_deg alone grows" not in asked.output and "no column tells the time" in asked.output
