"""Tables in the dress that people and programs put on them: the truth, a question or a refusal, never anything else."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import openpyxl
import pytest
from click.testing import Result

from drivers.files.read_log import read_log

DEALS = 24
SEED = 20261122


@pytest.mark.parametrize("number", [
    number if number < DEALS // 2 else pytest.param(number, marks=pytest.mark.exam) for number in range(DEALS)])
def test_a_dress_is_seen_through_or_asked_about(number: int, dresses: ModuleType, tmp_path: Path) -> None:
    what, lines = dresses.problems(dresses.dress(number, SEED), dresses.D.true_log(), tmp_path)
    assert what in ("imported", "asked", "refused"), lines


def test_the_deals_of_the_suite_meet_much(dresses: ModuleType) -> None:
    deals = [dresses.dress(number, SEED) for number in range(DEALS)]
    assert {of.kind for of in deals} == {"text", "excel"} and {of.language for of in deals} == {"en", "de", "zh"}
    assert {of.between for of in deals} == set(dresses.BETWEEN) and {of.footer for of in deals} == set(dresses.FOOTERS)
    assert len({of.time for of in deals}) >= 9 and len({of.encoding for of in deals}) >= 5


def log_of(times: list[str], head: str = "Time,Speed [m/s],Shaft speed [r/min]", tail: str = "") -> str:
    rows = (f"{time},{1.5 + 0.01 * (k % 7):.2f},{40 + k % 5}.25{tail}" for k, time in enumerate(times))
    return "\n".join([head, *rows])


@pytest.mark.parametrize("day", ["07-03-26", "17-03-26"])
def test_a_year_of_two_digits_is_no_year_7(topdress: Callable[..., Result], written: Callable[..., Path],
                                           tmp_path: Path, day: str) -> None:
    source = written(log_of([f"{day} 08:{k // 60:02d}:{k % 60:02d}" for k in range(90)]))
    done = topdress("import", source, "--out", tmp_path / "out.csv")
    assert done.exit_code == 2 and "both read: which is the day?" in done.output, done.output
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("tail", ["", ".250", ",250"])
def test_day_and_time_in_one_run_of_digits(topdress: Callable[..., Result], written: Callable[..., Path],
                                           tmp_path: Path, tail: str) -> None:
    text = log_of([f"20260317{8:02d}{k // 60:02d}{k % 60:02d}{tail}" for k in range(90)])
    if "," in tail:
        text = text.replace(tail, "#").replace(",", ";").replace("#", tail)
    done = topdress("import", written(text), "--out", tmp_path / "out.csv")
    assert done.exit_code == 0, done.output
    assert read_log(tmp_path / "out.csv").duration_s == 89.0


def test_a_delimiter_after_the_last_cell_beside_quotes(topdress: Callable[..., Result], written: Callable[..., Path],
                                                       tmp_path: Path) -> None:
    lines = log_of([str(k) for k in range(90)], "Time [s],Speed [m/s],Shaft speed [r/min]").splitlines()
    text = "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) + "," for line in lines)
    done = topdress("import", written(text), "--out", tmp_path / "out.csv")
    assert done.exit_code == 0, done.output
    log = read_log(tmp_path / "out.csv")
    assert len(log) == 90 and log.numbers("shaft_rpm")[3] == 43.25


def test_notes_of_a_few_rows_beside_the_log_s_sheet_are_left_out_and_said(topdress: Callable[..., Result],
                                                                          tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    assert book.active is not None
    for row in (["Name", "Value"], ["Area", 12.5], ["Width", 2.4]):
        book.active.append(row)
    sheet = book.create_sheet("Data")
    sheet.append(["Time [s]", "Speed [m/s]", "Shaft speed [r/min]"])
    for k in range(90):
        sheet.append([k, 1.5 + 0.01 * (k % 7), 40.25 + k % 5])
    book.save(tmp_path / "log.xlsx")
    done = topdress("import", tmp_path / "log.xlsx", "--out", tmp_path / "out.csv")
    assert done.exit_code == 0, done.output
    assert len(read_log(tmp_path / "out.csv")) == 90 and "sheet Sheet left out: 3 rows beside a log" in done.output
