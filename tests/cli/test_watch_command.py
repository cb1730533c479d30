"""`topdress watch`: lines for a person, one clear line where nothing can be said, and an end
where one is asked for."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from topdress.console.services import live_check
from topdress.console.services.live_check import CheckResult
from topdress.control.diagnosis.result import ModelDeviation

from tests.command import topdress

FOUND = ModelDeviation("flow", "flow.fill_falloff", -4.0, 600.0, adoptable=True)


@pytest.fixture(autouse=True)
def _own_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_check, "lower_priority", lambda: None)


def rows(count: int) -> str:
    return "time_s,speed_mps,wheel_speed_mps\n" + "".join(
        f"{0.1 * k:.1f},1.3,1.31\n" for k in range(count)
    )


def test_what_departs_is_said_once_and_when_it_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def followed(
        log: Path, machine: str | None, wait: Callable[[], bool], tell: object
    ) -> Iterator[CheckResult]:
        yield from (
            CheckResult(330.0, None),
            CheckResult(660.0, FOUND, False),
            CheckResult(690.0, FOUND),
            CheckResult(2700.0, None),
        )

    monkeypatch.setattr(live_check, "follow_log", followed)
    log = tmp_path / "run.csv"
    log.write_text(rows(3))
    done = topdress("watch", log, "--to-end")
    assert done.exit_code == 0
    assert done.stdout.splitlines() == [
        "0:11:00  4 % too little flows since 0:10:00. Probably: Flutes fill less at high "
        "shaft speed; "
        "adopt it into the machine file: topdress diagnose --adopt",
        "0:45:00  as the model says again",
    ]
    assert "4 looks" in done.stderr
    done = topdress("watch", log, "--to-end", "--json")
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert [one["at_s"] for one in found] == [660.0, 2700.0] and found[0]["departure"][
        "cause"
    ] == FOUND.cause


@pytest.mark.parametrize("text", ["", rows(100)])
def test_a_log_that_is_too_short_is_no_healthy_machine(tmp_path: Path, text: str) -> None:
    log = tmp_path / "run.csv"
    log.write_text(text)
    done = topdress("watch", log, "--to-end")
    assert done.exit_code == 2
    assert done.stderr.strip() == f"{log}: too short: nothing is said before 5 minutes of rows"


def test_ctrl_c_ends_it_and_it_says_beforehand_that_it_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def followed(*_: object) -> Iterator[CheckResult]:
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(live_check, "follow_log", followed)
    done = topdress("watch", tmp_path / "coming.csv")
    assert done.exit_code == 0 and "waited for" in done.stderr and "0 looks" in done.stderr


def test_what_cannot_be_watched_is_one_line(tmp_path: Path) -> None:
    for name, data in (("odd.csv", bytes(range(256)) * 20), ("cut.parquet", b"PAR1 and no more")):
        (tmp_path / name).write_bytes(data)
        done = topdress("watch", tmp_path / name, "--to-end")
        assert (
            done.exit_code == 2 and name in done.stderr and "fault of topdress" not in done.stderr
        )
    gone = topdress("watch", tmp_path / "nowhere.csv", "--to-end")
    assert gone.exit_code == 2 and gone.stderr.strip().endswith("no such file")
