import csv
import errno
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydantic import BaseModel
from topdress.control.log_row import COLUMNS, TEXT_COLUMNS, VALID_FOR_S, LogRow
from topdress.control.readings import Measurements, Reading
from topdress.drivers.files.atomic_files import NewFile, create_new_file
from topdress.drivers.files.log_text import (
    LOG_HEADER,
    MAX_CUT_CELL_CHARACTERS,
    MAX_ROW_BYTES,
    RowText,
)
from topdress.drivers.files.read_log import RunLog, read_log
from topdress.drivers.files.replay import iter_measurements
from topdress.drivers.files.run_log import PlainLogWriter, RunLogWriter, write_whole_log
from topdress.drivers.files.run_meta import RunMeta, make_run_meta, parse_meta_yaml

from tests.waiting import wait_for

MakeRow = Callable[[float], LogRow]
META = RunMeta(software="topdress test")


class Shaky:
    """A disk that can be made to refuse, to take half of what it is given, or to hang."""

    def __init__(self) -> None:
        self.refuse: OSError | None = None
        self.refuse_open: OSError | None = None
        self.take_at_most: int | None = None
        self.hang = threading.Event()
        self.hang.set()
        self.threads: set[int] = set()

    def create(self, path: Path, overwrite: bool) -> NewFile:
        if self.refuse_open is not None:
            raise self.refuse_open
        return _ShakyFile(create_new_file(path, overwrite), self)


class _ShakyFile(NewFile):
    def __init__(self, file: NewFile, disk: Shaky) -> None:
        self._file, self._disk, self.path = file._file, disk, file.path

    def write(self, data: bytearray) -> int:
        self._disk.threads.add(threading.get_ident())
        self._disk.hang.wait()
        if self._disk.refuse is not None:
            raise self._disk.refuse
        return super().write(data[: self._disk.take_at_most])


def full_disk() -> OSError:
    return OSError(errno.ENOSPC, "No space left on device")


def test_a_row_is_one_line_in_the_published_order(full_row: MakeRow) -> None:
    cells = RowText().line(full_row(0.05)).rstrip("\n").split(",")
    assert len(cells) == len(COLUMNS)
    row = dict(zip(COLUMNS, cells, strict=True))
    assert (row["time_s"], row["lat_deg"], row["shaft_rpm"]) == ("0.050", "34.100000563", "69.900")
    assert (row["state"], row["work_switch"], row["events"]) == (
        "working",
        "1",
        "mark corner;refill 120",
    )
    assert LOG_HEADER.rstrip("\n").split(",") == list(COLUMNS)


def test_commands_are_written_exactly() -> None:
    for value in (0.1 + 0.2, 1 / 3, 69.99999999999999, 1e-17):
        line = RowText().line(
            LogRow(0.0, shaft_rpm_cmd=value, opening_mm_cmd=value, target_rate_kg_ha=value)
        )
        row = dict(zip(COLUMNS, line.split(","), strict=True))
        assert (
            float(row["shaft_rpm_cmd"])
            == float(row["opening_mm_cmd"])
            == float(row["target_rate_kg_ha"])
            == value
        )


def test_what_is_not_known_or_not_finite_is_empty() -> None:
    line = RowText().line(
        LogRow(1.0, speed_mps=float("nan"), hopper_kg=float("inf"), fix_quality=None)
    )
    assert line == "1.000" + "," * (len(COLUMNS) - 1) + "\n"


@pytest.mark.parametrize(
    "text", ["a,b", 'say "so"', "two\nlines", "cr\rhere", "nan", "info", "zero\0byte", "雨"]
)
def test_texts_never_break_a_line(text: str) -> None:
    line = RowText().line(LogRow(0.0, state="off", events=text))
    assert line.count("\n") == 1 and line.endswith("\n") and "\r" not in line and "\0" not in line
    (cells,) = csv.reader([line])
    assert dict(zip(COLUMNS, cells, strict=True))["events"] == text.translate(
        {10: " ", 13: " ", 0: " "}
    )


def test_two_rows_in_one_millisecond_keep_their_order() -> None:
    text = RowText()
    times = [text.line(LogRow(time_s)).split(",")[0] for time_s in (1.0, 1.0001, 1.05)]
    assert times == ["1.000", "1.000100", "1.050"]


def test_the_sidecar_says_with_what_the_run_was_made(tmp_path: Path, full_row: MakeRow) -> None:
    class Crop(BaseModel):
        format: str = "topdress-crop/1"
        y_max_t_ha: float = 7.5

    meta = make_run_meta(
        {"id": "huanghai"},
        Crop(),
        None,
        seed=7,
        sha256={"a.yaml": "00ff"},
        started_utc="2026-03-20T08:00:00.000Z",
        extra={"effects": ["flow.gain=5"]},
    )
    path = write_whole_log(tmp_path / "run.csv", meta, [full_row(0.0)])
    text = path.with_suffix(".yaml").read_text()
    said = yaml.safe_load(text)
    assert said["format"] == "topdress-run-log/1"
    assert said["software"].startswith("topdress ")
    assert (said["machine"], said["crop"]["y_max_t_ha"], said["job"]) == (
        {"id": "huanghai"},
        7.5,
        None,
    )
    assert (said["seed"], said["sha256"]) == (7, {"a.yaml": "00ff"})
    assert parse_meta_yaml(text) == meta


def test_an_existing_log_is_left_alone_unless_asked(tmp_path: Path, full_row: MakeRow) -> None:
    first = write_whole_log(tmp_path / "run.csv", META, [full_row(0.0)])
    before = first.read_bytes()
    second = write_whole_log(tmp_path / "run.csv", META, [full_row(1.0)])
    with RunLogWriterClosing(RunLogWriter(tmp_path / "run.csv", META)) as third:
        assert third.path.name == "run-3.csv"
    assert second.name == "run-2.csv"
    assert first.read_bytes() == before
    again = write_whole_log(tmp_path / "run.csv", META, [full_row(2.0)], overwrite=True)
    assert again == first and first.read_text().splitlines()[1].startswith("2.000,")


class RunLogWriterClosing:
    def __init__(self, writer: RunLogWriter) -> None:
        self.writer = writer

    def __enter__(self) -> RunLogWriter:
        return self.writer

    def __exit__(self, *_: object) -> None:
        self.writer.close()


def test_rows_reach_the_disk_while_the_run_goes_on(tmp_path: Path, full_row: MakeRow) -> None:
    with RunLogWriterClosing(
        RunLogWriter(tmp_path / "run.csv", META, flush_s=0.01, sync_s=0.01)
    ) as log:
        for tick in range(40):
            log.append(full_row(tick * 0.05))
        wait_for(lambda: log.path.read_text().count("\n") == 41)
        assert log.ok and log.trouble == ""
    assert log.close() and log._lost == 0


def test_the_default_rhythm_is_within_a_second(tmp_path: Path, full_row: MakeRow) -> None:
    with RunLogWriterClosing(RunLogWriter(tmp_path / "run.csv", META)) as log:
        log.append(full_row(0.0))
        wait_for(lambda: log.path.read_text().count("\n") == 2, 1.5)


def test_the_caller_never_touches_the_disk(tmp_path: Path, full_row: MakeRow) -> None:
    disk = Shaky()
    with RunLogWriterClosing(
        RunLogWriter(tmp_path / "run.csv", META, create=disk.create, flush_s=0.01)
    ) as log:
        disk.threads.clear()
        disk.hang.clear()
        started = time.thread_time()
        for tick in range(1000):
            log.append(full_row(tick * 0.05))
        assert time.thread_time() - started < 0.5
        disk.hang.set()
        wait_for(lambda: log.path.read_text().count("\n") == 1001)
        assert threading.get_ident() not in disk.threads


def test_a_full_disk_is_told_and_no_row_is_lost_when_it_ends(
    tmp_path: Path, full_row: MakeRow
) -> None:
    disk = Shaky()
    opened = RunLogWriter(tmp_path / "run.csv", META, create=disk.create, flush_s=0.01, sync_s=0.0)
    with RunLogWriterClosing(opened) as log:
        # the last write before the end of the disk takes a part of a row
        disk.take_at_most = 100
        log.append(full_row(0.0))
        wait_for(lambda: log.path.read_text().count("\n") == 2)
        disk.refuse = full_disk()
        for tick in range(1, 50):
            log.append(full_row(tick * 0.05))
        wait_for(lambda: not log.ok)
        assert "run.csv" in log.trouble and "No space left on device" in log.trouble
        disk.refuse = None
        wait_for(lambda: log.ok)
    assert log._lost == 0
    rows = list(csv.DictReader(log.path.open()))
    assert [float(row["time_s"]) for row in rows] == [round(tick * 0.05, 3) for tick in range(50)]


def test_rows_that_cannot_wait_any_longer_are_counted(tmp_path: Path, full_row: MakeRow) -> None:
    disk = Shaky()
    log = RunLogWriter(
        tmp_path / "run.csv", META, create=disk.create, flush_s=0.01, max_waiting_rows=20
    )
    disk.refuse = full_disk()
    for tick in range(100):
        log.append(full_row(tick * 0.05))
    wait_for(lambda: not log.ok)
    assert log._lost == 80
    assert not log.close()


def test_a_disk_that_hangs_is_told(tmp_path: Path, full_row: MakeRow) -> None:
    disk, now_s = Shaky(), [0.0]
    log = RunLogWriter(
        tmp_path / "run.csv", META, create=disk.create, clock=lambda: now_s[0], flush_s=0.01
    )
    disk.hang.clear()
    log.append(full_row(0.0))
    assert log.ok
    now_s[0] = 19.0
    assert log.ok, "memory takes the rows"
    now_s[0] = 21.0
    wait_for(lambda: not log.ok)
    assert "has not answered" in log.trouble
    disk.hang.set()
    wait_for(lambda: log.ok)
    assert log.close()


def test_an_unwritable_place_is_told_and_tried_again(tmp_path: Path, full_row: MakeRow) -> None:
    (tmp_path / "card").write_text("a file where a folder should be")
    log = RunLogWriter(tmp_path / "card" / "run.csv", META, flush_s=0.01, sync_s=0.0)
    log.append(full_row(0.0))
    assert not log.ok and "run.csv: log not written: " in log.trouble
    (tmp_path / "card").unlink()
    wait_for(lambda: log.ok)
    assert log.close()
    assert log.path.read_text().count("\n") == 2


def test_failing_to_open_leaves_no_litter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise full_disk()

    monkeypatch.setattr("topdress.drivers.files.run_log.write_atomically", full)
    log = RunLogWriter(tmp_path / "run.csv", META, flush_s=0.002)
    time.sleep(0.05)
    assert not log.close()
    assert list(tmp_path.iterdir()) == []


def rows_of(log: RunLogWriter) -> list[str]:
    return [line.split(",")[0] for line in log.path.read_text().splitlines()[1:]]


def test_a_log_deleted_under_way_is_told_and_written_anew(
    tmp_path: Path, full_row: MakeRow
) -> None:
    log = RunLogWriter(tmp_path / "run.csv", META, flush_s=0.01, sync_s=0.0)
    log.append(full_row(0.0))
    wait_for(lambda: rows_of(log) == ["0.000"])
    troubles = []
    try:
        log.path.unlink()
    except PermissionError:
        pytest.skip("this system does not delete open files")
    wait_for(
        lambda: bool(
            troubles.append(log.trouble) or "no longer where it was started" in "".join(troubles)
        )
    )
    log.append(full_row(0.05))
    wait_for(lambda: log.ok and log.path.exists() and len(rows_of(log)) == 2)
    assert log.close() and rows_of(log) == ["0.000", "0.050"]


@pytest.mark.parametrize("lost_bytes", [0, 30])
def test_a_log_whose_folder_comes_back_is_written_on(
    tmp_path: Path, full_row: MakeRow, lost_bytes: int
) -> None:
    """The card is pulled and put in again: the same names, other files for the system; the last
    bytes may be gone."""
    folder, away = tmp_path / "card", tmp_path / "away"
    log = RunLogWriter(folder / "run.csv", META, flush_s=0.01, sync_s=0.0)
    log.append(full_row(0.0))
    log.append(full_row(0.05))
    wait_for(lambda: len(rows_of(log)) == 2)
    folder.rename(away)
    log.append(full_row(0.1))
    wait_for(lambda: not log.ok)
    log.append(full_row(0.15))
    time.sleep(0.05)
    assert not folder.exists(), "nothing is written where the card should be"
    card = tmp_path / "put in again"
    card.mkdir()
    for name in ("run.csv", "run.yaml"):
        data = (away / name).read_bytes()
        (card / name).write_bytes(data[: len(data) - lost_bytes] if name == "run.csv" else data)
    card.rename(folder)  # all its files at once, as a mount brings them
    log.append(full_row(0.2))
    wait_for(lambda: log.ok)
    assert log.close()
    told = rows_of(log)
    assert told == sorted(set(told)) and told[0] == "0.000" and told[-2:] == ["0.150", "0.200"]
    assert log.path == folder / "run.csv" and len(told) >= 5 - (lost_bytes > 0) - 1
    assert all(
        line.count(",") == LOG_HEADER.count(",") for line in log.path.read_text().splitlines()
    )


@pytest.mark.parametrize("left", ["none", "header", "all but a row and a half"])
def test_a_log_that_is_cut_short_goes_on_in_a_new_one(
    tmp_path: Path, full_row: MakeRow, left: str
) -> None:
    """It went on behind a hole of zeros as long as what was taken away, without a header: no
    reader could take it."""
    log = RunLogWriter(tmp_path / "run.csv", META, flush_s=0.01, sync_s=0.0)
    for tick in range(10):
        log.append(full_row(tick * 0.05))
    wait_for(lambda: len(rows_of(log)) == 10 and not log._unsynced)
    log._sync_s = 1e9  # what comes now is written and perhaps not kept
    log.append(full_row(0.5))
    log.append(full_row(0.55))
    wait_for(lambda: len(rows_of(log)) == 12)
    text = log.path.read_bytes()
    row = len(text.splitlines(keepends=True)[-1])
    os.truncate(
        log.path,
        {"none": 0, "header": len(LOG_HEADER.encode())}.get(left, len(text) - row * 3 // 2),
    )
    log.append(full_row(0.6))
    wait_for(lambda: log.cut_short is not None)
    log.append(full_row(0.65))
    assert (
        log.close()
        and log.ok
        and log.cut_short == tmp_path / "run.csv"
        and log.path == tmp_path / "run-2.csv"
    )
    assert rows_of(log) == ["0.500", "0.550", "0.600", "0.650"]
    assert b"\0" not in (tmp_path / "run.csv").read_bytes() + log.path.read_bytes()
    assert (
        len(read_log(log.path)) == 4
        and parse_meta_yaml(log.path.with_suffix(".yaml").read_text()) == META
    )


def test_a_row_that_is_none_never_ends_the_log(tmp_path: Path, full_row: MakeRow) -> None:
    log = RunLogWriter(tmp_path / "run.csv", META, flush_s=0.01)
    log.append(full_row(0.0)._replace(speed_mps="fast"))  # type: ignore[arg-type]
    log.append(full_row(0.05))
    assert not log.close()
    assert log._lost == 1
    assert log.path.read_text().count("\n") == 2


@pytest.mark.exam
def test_an_hour_is_written_at_the_pace_of_its_first_minutes(
    tmp_path: Path, full_row: MakeRow
) -> None:
    row = full_row(0.0)
    rows = [row._replace(time_s=tick * 0.05) for tick in range(72_000)]
    took_s = []
    with PlainLogWriter(tmp_path / "run.csv", META) as log:
        for start in range(0, 72_000, 9_000):
            started_s = time.thread_time()
            for row in rows[start : start + 9_000]:
                log.append(row)
            took_s.append(time.thread_time() - started_s)
    assert min(took_s[4:]) < 2.0 * min(took_s[:4])
    assert log.path.read_text().count("\n") == 72_001


def test_writing_needs_no_heavy_library() -> None:
    code = (
        "import sys; import topdress.drivers.files.run_log, drivers.files.config; "
        "heavy = {'polars', 'numba', 'scipy', 'textual', 'rich', 'numpy'} & "
        "set(sys.modules); "
        "sys.exit(' '.join(sorted(heavy)) or None)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_slow_disk_delays_no_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, full_row: MakeRow
) -> None:
    """A disk may take a second to say that a file is kept: the log's own thread waits for it."""
    kept_by: list[str] = []
    fsync = os.fsync
    monkeypatch.setattr(
        os,
        "fsync",
        lambda handle: (kept_by.append(threading.current_thread().name), fsync(handle))[1],
    )
    log = RunLogWriter(tmp_path / "run.csv", META, flush_s=0.01, sync_s=0.0)
    begun = (tmp_path / "run.csv").read_bytes(), (tmp_path / "run.yaml").read_bytes()
    log.append(full_row(0.0))
    assert log.close()
    assert all(begun), "the names are taken at once"
    assert set(kept_by) == {"run-log"} and len(kept_by) >= 3, "header, sidecar and folder are kept"


@pytest.mark.parametrize(
    "letter", ["x", "\u00e4", "\U0001f33e", '"', ","], ids=["1", "2", "4", "quote", "comma"]
)
def test_no_row_is_longer_than_a_reader_takes(tmp_path: Path, letter: str) -> None:
    """Texts of any length in every column of texts: cut, and read back with all other rows."""
    texts = dict.fromkeys(TEXT_COLUMNS & set(COLUMNS) - {"utc"}, letter * 300_000)
    rows = [LogRow(0.05 * k, state="working", speed_mps=1.0, events=f"mark {k}") for k in range(20)]
    rows[7] = rows[7]._replace(**texts)
    path = write_whole_log(tmp_path / "run.csv", META, rows)
    assert max(map(len, path.read_bytes().split(b"\n"))) <= MAX_ROW_BYTES
    read = read_log(path)
    assert len(read) == 20 and read.columns["events"][8] == "mark 8"
    assert read.columns["events"][7] == letter * (MAX_CUT_CELL_CHARACTERS - 3) + "..."


def test_a_row_of_many_bytes_that_fits_is_left_as_it_is() -> None:
    text = "\u00e4" * 10_000
    assert text in RowText().line(LogRow(0.0, events=text))


Written = Callable[..., Path]
TICK_S = 0.05


class Sensor:
    """A sensor of a given period, silent for a while, and the cell that the loop writes for it."""

    def __init__(
        self,
        period_s: float,
        hold_s: float,
        silent: tuple[float, float] = (99.0, 99.0),
        seed: int = 0,
        steady: bool = False,
    ) -> None:
        self.period_s, self.hold_s, self.silent, self.steady = period_s, hold_s, silent, steady
        self.random = np.random.default_rng(seed)
        self.newest: Reading | None = None
        self.next_s = 0.0

    def at(self, now_s: float) -> float | None:
        if now_s >= self.next_s - 1e-9:
            self.next_s += self.period_s
            if not self.silent[0] <= now_s < self.silent[1]:
                value = 25.1 if self.steady else round(float(self.random.normal(50.0, 1.0)), 3)
                self.newest = Reading(value, now_s)
        if self.newest is None or now_s - self.newest.time_s > self.hold_s + 1e-9:
            return None
        return self.newest.value


def logged(
    tmp_path: Path, column: str, sensor: Sensor, seconds: float = 30.0
) -> tuple[RunLog, list[Reading | None]]:
    rows, truth = [], []
    for k in range(round(seconds / TICK_S)):
        rows.append(LogRow(round(k * TICK_S, 3))._replace(**{column: sensor.at(k * TICK_S)}))
        truth.append(sensor.newest)
    return read_log(write_whole_log(tmp_path / "run.csv", RunMeta(), rows, overwrite=True)), truth


def the_reading(m: Measurements, column: str) -> Reading | None:
    return m.ndvi[0] if column == "ndvi_1" else getattr(m, column)


@pytest.mark.parametrize(
    ("column", "period_s"),
    [("shaft_rpm", 0.05), ("opening_mm", 0.1), ("wheel_speed_mps", 0.2), ("hopper_kg", 0.1)],
)
def test_values_and_their_times_come_back(tmp_path: Path, column: str, period_s: float) -> None:
    log, truth = logged(
        tmp_path, column, Sensor(period_s, VALID_FOR_S[column], silent=(10.0, 15.0))
    )
    for m, true in zip(iter_measurements(log), truth, strict=True):
        reading = the_reading(m, column)
        assert reading is not None and true is not None
        assert reading.value == true.value
        assert reading.time_s == pytest.approx(true.time_s, abs=TICK_S + 1e-6), (
            m.time_s,
            reading,
            true,
        )


def test_a_silent_head_grows_old_as_it_did(tmp_path: Path) -> None:
    sensor = Sensor(0.5, VALID_FOR_S["ndvi_1"], silent=(10.0, 20.0))
    sensor.random = np.random.default_rng(3)
    original = sensor.random.normal
    sensor.random = type("R", (), {"normal": staticmethod(lambda *_: original(0.5, 0.01))})()  # type: ignore[assignment]
    log, truth = logged(tmp_path, "ndvi_1", sensor)
    for m, true in zip(iter_measurements(log), truth, strict=True):
        reading = m.ndvi[0]
        assert reading is not None and true is not None
        assert (reading.value, reading.time_s) == (
            true.value,
            pytest.approx(true.time_s, abs=TICK_S + 1e-6),
        )


def test_a_steady_value_that_comes_is_never_taken_for_silence(tmp_path: Path) -> None:
    log, truth = logged(
        tmp_path,
        "opening_mm",
        Sensor(0.05, VALID_FOR_S["opening_mm"], silent=(20.0, 99.0), steady=True),
    )
    for m, true in zip(iter_measurements(log), truth, strict=True):
        assert m.opening_mm is not None and true is not None
        age_s, true_age_s = m.time_s - m.opening_mm.time_s, m.time_s - true.time_s
        assert age_s == pytest.approx(true_age_s, abs=VALID_FOR_S["opening_mm"] + TICK_S)
        if m.time_s < 19.0:
            assert age_s < TICK_S
        if m.time_s > 20.6:
            assert age_s == pytest.approx(true_age_s, abs=TICK_S + 1e-6)


def test_a_rare_change_is_not_a_slow_sensor(written: Written) -> None:
    lines = [f"{k * 0.05:.2f},{25 if k < 300 else 26}" for k in range(600)]
    log = read_log(written("time_s,opening_mm\n" + "\n".join(lines) + "\n"))
    for m in iter_measurements(log):
        assert m.opening_mm is not None
        assert m.time_s - m.opening_mm.time_s <= VALID_FOR_S["opening_mm"] / 2 + 1e-6


def test_never_received_is_none_and_no_sensor_stays_none(written: Written) -> None:
    log = read_log(written("time_s,hopper_kg,work_switch\n0,,\n1,5,1\n2,,0\n"))
    first, second, third = iter_measurements(log)
    assert (
        first.hopper_kg is None
        and second.hopper_kg == Reading(5.0, 1.0)
        and third.hopper_kg == Reading(5.0, 1.0)
    )
    assert (first.work_switch, second.work_switch, third.work_switch) == (None, True, False)
    assert first.gnss is None and first.shaft_rpm is None and third.ndvi == (None,)


def test_a_new_utc_makes_a_new_fix(written: Written) -> None:
    lines = ["time_s,utc,lat_deg,lon_deg,fix_quality,satellites,speed_mps,heading_deg"]
    for k in range(20):
        tenth = k // 4
        lines.append(f"{k * 0.05:.2f},2026-03-20T08:00:00.{2 * tenth}00Z,34.1,119.5,4,12,0.0,")
    log = read_log(written("\n".join(lines) + "\n"))
    for k, m in enumerate(iter_measurements(log)):
        assert m.gnss is not None
        assert m.gnss.time_s == pytest.approx(k // 4 * 0.2)
        assert m.gnss.utc == f"2026-03-20T08:00:00.{2 * (k // 4)}00Z"
        assert (m.gnss.fix_quality, m.gnss.satellites, m.gnss.hdop, m.gnss.heading_deg) == (
            4,
            12,
            None,
            None,
        )


def test_a_lost_fix_stays_the_newest_and_grows_old(written: Written) -> None:
    lines = ["time_s,utc,lat_deg,lon_deg"]
    lines += [
        f"{k / 10:.1f},2026-03-20T08:00:00.{k}00Z,{34.1 + k * 1e-6:.6f},119.5" for k in range(5)
    ]
    lines += [f"{k / 10:.1f},,," for k in range(5, 9)]
    lines += ["0.9,2026-03-20T08:00:00.900Z,34.2,119.5"]
    fixes = [m.gnss for m in iter_measurements(read_log(written("\n".join(lines) + "\n")))]
    assert [fix.time_s for fix in fixes if fix] == pytest.approx(
        [0, 0.1, 0.2, 0.3, 0.4, 0.4, 0.4, 0.4, 0.4, 0.9]
    )
    assert fixes[8] is not None and fixes[8].lat_deg == pytest.approx(34.100004)
    assert fixes[8].fix_quality == 1


def test_a_place_that_comes_after_its_utc_is_as_old_as_itself(written: Written) -> None:
    utc = "2026-03-20T08:00:00.000Z"
    log = read_log(
        written(f"time_s,utc,lat_deg,lon_deg\n0,{utc},,\n1,{utc},34.1,119.5\n2,{utc},34.1,119.5\n")
    )
    assert [m.gnss and m.gnss.time_s for m in iter_measurements(log)] == [None, 1.0, 1.0]


def test_without_utc_a_new_place_makes_a_new_fix(written: Written) -> None:
    lines = [f"{k * 0.05:.2f},{34.1 + k // 2 * 1e-6:.6f},119.5" for k in range(40)]
    log = read_log(written("time_s,lat_deg,lon_deg\n" + "\n".join(lines) + "\n"))
    assert [m.gnss.time_s for m in iter_measurements(log) if m.gnss] == pytest.approx(
        [k // 2 * 0.1 for k in range(40)]
    )


def test_a_speed_without_places_is_replayed_as_the_wheel(written: Written) -> None:
    log = read_log(written("time_s,speed_mps,ndvi\n0,1.2,0.5\n1,1.3,0.6\n"))
    readings = [m.wheel_speed_mps for m in iter_measurements(log)]
    assert [reading.value for reading in readings if reading] == [1.2, 1.3]


def test_an_empty_log_replays_nothing(written: Written) -> None:
    log = read_log(written("time_s,speed_mps\n"))
    assert list(iter_measurements(log)) == [] and list(log.rows()) == []
