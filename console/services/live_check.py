"""The live check as a process of its own:
`python -m topdress.console.services.live_check LOG [MACHINE]`.

It follows a growing log with the lowest priority and says what departs from the model as lines
of JSON on stdout: {"departure": {...} or null, "at_s": 612.0}, whenever that changes, or
{"error": "one line"} and ends. It ends with its stdin, so that no console leaves one behind.
Nothing waits for it: it reads a file, and may be slow or dead.
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
    from topdress.control.diagnosis.result import Departure
    from topdress.control.machine.machine import Machine
    from topdress.drivers.files.columns import Columns

NICENESS = 19
POLL_S = 5.0
# without a new row, after which a log is said to grow no longer
GROWTH_TIMEOUT_S = 60.0
# of one core's time, that bringing in the log may take
MOST_IMPORT_SHARE = 0.05
DEFAULT_MACHINE = "huanghai"


class CheckResult(NamedTuple):
    """Holds the departure that stands after a check, and its time in the log; newest: false for
    rows that came long ago."""

    at_s: float
    departure: Departure | None
    newest: bool = True


def load_log_machine(log: Path, machine: str | None, default: str = DEFAULT_MACHINE) -> Machine:
    """The machine as given, else as the log names it, else the default one. Raises ConfigError."""
    from topdress.drivers.files.config import load_config, validate_config
    from topdress.drivers.files.kinds import MACHINE
    from topdress.drivers.files.read_log import read_log_meta

    if machine is None:
        meta = read_log_meta(log)
        if meta is not None and meta.machine is not None:
            return validate_config(meta.machine, MACHINE, str(log.with_suffix(".yaml")))
    return load_config(machine or default, MACHINE).model


def follow_log(
    log: Path,
    machine: str | None,
    wait: Callable[[], bool],
    tell: Callable[[str], None] = lambda said: None,
) -> Iterator[CheckResult]:
    """The result of each check, for ever; `wait` returns False where that is enough.

    tell: takes the notes on the file itself. Rows that are there already are gone through as if
    they came now. Rows that are earlier than those before are another log's, which is checked from
    its beginning. Raises TableError, ConfigError, OSError.
    """
    from topdress.control.diagnosis.live.watch import LiveCheck
    from topdress.drivers.files.growing_log import GrowingLog

    growing, check, state = GrowingLog(log), None, _FileReporter(log, tell)
    while True:
        begin_s = time.process_time()
        rows = growing.more()
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
            check.add(piece)
            if check.due:
                standing = check.look()
                yield CheckResult(
                    check.now_s, standing, k == len(pieces) - 1 and not growing.behind
                )
        # a log that is brought in anew each time
        for _ in range(int(took_s / (MOST_IMPORT_SHARE * POLL_S))):
            if not wait():
                break


class _FileReporter:
    """Reports lines left out of the followed file, and that it no longer grows."""

    def __init__(self, log: Path, tell: Callable[[str], None]) -> None:
        self._log, self._tell = log, tell
        self._damaged, self._looks, self._grew = 0, 0, False

    def report_poll(self, damaged: int, grew: bool) -> None:
        """Report changes after each poll of the file, POLL_S apart."""
        if damaged > self._damaged:
            self._damaged = damaged
            self._tell(
                f"{self._log}: {damaged} damaged line{'s' if damaged > 1 else ''} left out so far"
            )
        still = round(GROWTH_TIMEOUT_S / POLL_S)
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
    """Rows that came at once, as they would have come: LOOK_S at a time."""
    import numpy as np
    from topdress.control.diagnosis.live.watch import LOOK_S

    looks = np.floor((rows["time_s"] - rows["time_s"][0]) / LOOK_S)
    begins = [0, *(np.flatnonzero(np.diff(looks)) + 1).tolist(), len(looks)]
    for begin, end in pairwise(begins):
        yield {name: array[begin:end] for name, array in rows.items()}


def run_live_check(arguments: list[str], sleep: Callable[[float], None] = time.sleep) -> int:
    """Follow a log and print departures; returns the exit code."""
    from topdress.drivers.files.config import ConfigError

    log, machine = Path(arguments[0]), arguments[1] if len(arguments) > 1 else None
    said: Departure | tuple[()] | None = ()

    def wait_for_poll() -> bool:
        sleep(POLL_S)
        return True

    try:
        for look in follow_log(log, machine, wait_for_poll):
            # what departed hours ago is not said as if it did now
            if look.newest and look.departure != said:
                said = look.departure
                _print_json_line(
                    {"departure": None if said is None else said._asdict(), "at_s": look.at_s}
                )
    except (ValueError, OSError, ConfigError) as error:  # TableError is a ValueError
        _print_json_line({"error": (str(error).splitlines() or [type(error).__name__])[0]})
    return 1


def lower_priority() -> None:
    """Give way to the control loop."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)


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
