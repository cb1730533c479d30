"""How does the live check run as a process of its own, `python -m
topdress.console.services.live_check LOG [MACHINE]`?

It follows a growing log with the lowest priority and prints departures from the model as lines of
JSON on stdout: {"departure": {...} or null, "at_s": 612.0} at every change, or {"error": "one
line"} before it ends. It ends with its stdin, so that no console leaves a process behind. No
program waits for it: it reads a file, and may be slow or fail.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from topdress.control.diagnosis.result import ModelDeviation
    from topdress.control.machine.machine import Machine
    from topdress.drivers.files.columns import Columns

CHECK_NICENESS = 19
LOG_POLL_S = 5.0
# Time without a new row after which a log counts as no longer growing, s.
GROWTH_TIMEOUT_S = 60.0
# Share of one core's time that the import of the log may take.
MAX_IMPORT_CORE_SHARE = 0.05
DEFAULT_MACHINE = "huanghai"


class CheckResult(NamedTuple):
    """Holds the departure after a check, and its time in the log; `newest` is False for rows that
    are older than the newest."""

    at_s: float
    departure: ModelDeviation | None
    newest: bool = True


def load_log_machine(log: Path, machine: str | None, default: str = DEFAULT_MACHINE) -> Machine:
    """Returns the given machine, else the machine that the log names, else the default. Raises
    ConfigError."""
    from topdress.drivers.files.config import load_config, validate_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND
    from topdress.drivers.files.read_log import read_log_meta

    if machine is None:
        meta = read_log_meta(log)
        if meta is not None and meta.machine is not None:
            return validate_config(meta.machine, MACHINE_KIND, str(log.with_suffix(".yaml")))
    return load_config(machine or default, MACHINE_KIND).model


def follow_log(
    log: Path,
    machine: str | None,
    wait: Callable[[], bool],
    tell: Callable[[str], None] = lambda said: None,
) -> Iterator[CheckResult]:
    """Yields the result of each check without end; `wait` returns False to stop.

    `tell` receives the notes on the file itself. Existing rows are processed as if they arrived
    now. Rows earlier than the previous rows belong to another log, which is checked from its
    beginning. Raises TableError, ConfigError, OSError.
    """
    from topdress.control.diagnosis.live.growing_log_check import LiveCheck
    from topdress.drivers.files.growing_log import GrowingLog

    growing, check, state = GrowingLog(log), None, _FileReporter(log, tell)
    while True:
        begin_s = time.process_time()
        rows = growing.read_new_rows()
        state.report_poll(growing.damaged, rows is not None)
        if rows is None:
            if not wait():
                return
            continue
        took_s = time.process_time() - begin_s
        if check is None or rows["time_s"][0] < check.now_s:
            check = LiveCheck(load_log_machine(log, machine))
        pieces = list(_split_rows(rows))
        for k, piece in enumerate(pieces):
            check.add_rows(piece)
            if check.is_due:
                standing = check.check_rows()
                yield CheckResult(
                    check.now_s, standing, k == len(pieces) - 1 and not growing.behind
                )
        # Such a log is imported again at each poll, so the pauses become longer.
        for _ in range(int(took_s / (MAX_IMPORT_CORE_SHARE * LOG_POLL_S))):
            if not wait():
                break


class _FileReporter:
    """Reports omitted lines of the followed file, and the end of its growth."""

    def __init__(self, log: Path, tell: Callable[[str], None]) -> None:
        self._log, self._tell = log, tell
        self._damaged, self._looks, self._grew = 0, 0, False

    def report_poll(self, damaged: int, grew: bool) -> None:
        """Reports changes after each poll of the file, `LOG_POLL_S` apart."""
        if damaged > self._damaged:
            self._damaged = damaged
            self._tell(
                f"{self._log}: {damaged} damaged line{'s' if damaged > 1 else ''} left out so far"
            )
        still = round(GROWTH_TIMEOUT_S / LOG_POLL_S)
        if grew:
            if self._looks >= still:
                self._tell(f"{self._log}: it grows again")
            self._looks, self._grew = 0, True
        elif self._grew:
            self._looks += 1
            if self._looks == still:
                self._tell(
                    f"{self._log}: no new row for {GROWTH_TIMEOUT_S:.0f} s: it no longer grows; "
                    "still watched"
                )


def _split_rows(rows: Columns) -> Iterator[Columns]:
    """Yields rows that arrived together in steps of `CHECK_INTERVAL_S`, as they would have
    arrived."""
    import numpy as np
    from topdress.control.diagnosis.live.growing_log_check import CHECK_INTERVAL_S

    looks = np.floor((rows["time_s"] - rows["time_s"][0]) / CHECK_INTERVAL_S)
    begins = [0, *(np.flatnonzero(np.diff(looks)) + 1).tolist(), len(looks)]
    for begin, end in pairwise(begins):
        yield {name: array[begin:end] for name, array in rows.items()}


def run_live_check(arguments: list[str], sleep: Callable[[float], None] = time.sleep) -> int:
    """Follows a log and prints departures; returns the exit code."""
    from topdress.drivers.files.config import ConfigError

    log, machine = Path(arguments[0]), arguments[1] if len(arguments) > 1 else None
    said: ModelDeviation | tuple[()] | None = ()

    def wait_for_poll() -> bool:
        sleep(LOG_POLL_S)
        return True

    try:
        for look in follow_log(log, machine, wait_for_poll):
            # A departure of hours ago must not be reported as a present one.
            if look.newest and look.departure != said:
                said = look.departure
                _print_json_line(
                    {"departure": None if said is None else said._asdict(), "at_s": look.at_s}
                )
    # TableError is a ValueError.
    except (ValueError, OSError, ConfigError) as error:
        _print_json_line({"error": (str(error).splitlines() or [type(error).__name__])[0]})
    return 1


def lower_priority() -> None:
    """Lowers the priority of this process below that of the control loop."""
    if hasattr(os, "nice"):
        os.nice(CHECK_NICENESS)


def _end_with_stdin() -> None:
    while sys.stdin.buffer.read(4096):
        pass
    os._exit(0)


def _print_json_line(what: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    lower_priority()
    threading.Thread(target=_end_with_stdin, daemon=True).start()
    sys.exit(run_live_check(sys.argv[1:]))
