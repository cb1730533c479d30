"""How does the console run the live check? One process checks the log that is being written, and
its last result is available at once.

A request never waits, because process and pipe belong to a thread. A check that crashes is started
again a few times. A check that hangs only leaves its last result in place.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from topdress.console.thread_limits import ONE_THREAD_VARIABLES

if TYPE_CHECKING:
    from topdress.control.diagnosis.result import ModelDeviation

CHECK_COMMAND = (sys.executable, "-P", "-m", "topdress.console.services.live_check")
# Pause before a restart after a crash, s.
RESTART_WAIT_S = 120.0
# Largest number of starts for one log.
MAX_STARTS = 3
# A diagnosis takes 100 MB for some seconds. Linux's allocator returns large blocks at once only as
# long as it does not learn from them to keep them (man mallopt): 313 MB after 41 minutes of a log,
# 229 MB with these settings.
MALLOC_ENVIRONMENT = {"MALLOC_MMAP_THRESHOLD_": "131072", "MALLOC_TRIM_THRESHOLD_": "131072"}


class LiveChecker:
    """Runs the check of a log. The first call of `find_departure(log)` starts the check, and ends
    the check of the previous log."""

    def __init__(
        self, program: Sequence[str] = CHECK_COMMAND, again_s: float = RESTART_WAIT_S
    ) -> None:
        self._program, self._again_s = tuple(program), again_s
        self._run: _CheckProcess | None = None

    def find_departure(self, log: str) -> ModelDeviation | None:
        """Returns the newest departure; None without a departure, and before the first result."""
        if self._run is None or self._run.log != log:
            self.stop_check()
            if not log:
                return None
            self._run = _CheckProcess(log, self._program, self._again_s)
        return self._run.departure

    def stop_check(self) -> None:
        """Ends the check that runs."""
        if self._run is not None:
            self._run.end_process()
            self._run = None


class _CheckProcess:
    """Runs the check of one log."""

    def __init__(self, log: str, program: tuple[str, ...], again_s: float) -> None:
        self.log = log
        self.departure: ModelDeviation | None = None
        self._program, self._again_s = program, again_s
        self._ended = threading.Event()
        self._child: subprocess.Popen[str] | None = None
        threading.Thread(target=self._run_with_restarts, name="model-check", daemon=True).start()

    def end_process(self) -> None:
        self._ended.set()
        child = self._child
        if child is not None:
            with contextlib.suppress(OSError):
                child.kill()

    def _run_with_restarts(self) -> None:
        for _ in range(MAX_STARTS):
            with contextlib.suppress(OSError):
                self._read_output()
            self.departure = None
            if self._ended.wait(self._again_s):
                return

    def _read_output(self) -> None:
        """Reads departures until the process ends. Its stdin stays open, because the process ends
        with this console."""
        from topdress.control.diagnosis.result import ModelDeviation

        with subprocess.Popen(
            [*self._program, self.log],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | ONE_THREAD_VARIABLES | MALLOC_ENVIRONMENT,
            start_new_session=True,
            text=True,
        ) as child:
            self._child = child
            if self._ended.is_set():
                child.kill()
            assert child.stdout is not None
            for said in child.stdout:
                with contextlib.suppress(ValueError, TypeError):
                    report = json.loads(said)
                    if "departure" in report:
                        self.departure = (
                            None
                            if report["departure"] is None
                            else ModelDeviation(**report["departure"])
                        )
