"""How is the code of a plug-in called safely? The code runs in its own process
(`drivers.plugin_host`).

An exception, an end of its process, a hang and an invalid result all become a `PluginFault`, which
names the plug-in in one line; the process is then ended.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections import Counter, deque
from contextlib import suppress
from datetime import datetime
from functools import cache
from math import isfinite
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

from topdress.control.readings import GnssFix
from topdress.drivers.devices.lines import Counts
from topdress.drivers.plain_text import join_lines
from topdress.drivers.plugin_host import JSON_BYTES_ENCODING
from topdress.drivers.plugins import Group, Plugin, PluginFault

# Time-out of loading, s; a large package needs some seconds to import on a small computer.
LOAD_TIMEOUT_S = 20.0
# Time-out of a decoder, s, for the bytes of some milliseconds of a line.
FEED_TIMEOUT_S = 2.0
# Time-out of a format, s; the built-in readers need less for a map of 256 MB.
FORMAT_TIMEOUT_S = 60.0
# Largest length of an answer, bytes, the same limit as for GeoJSON.
MAX_ANSWER_BYTES = 256 << 20
# Largest number of bytes of a line that wait for the plug-in: five seconds at 115,200 baud.
MAX_WAITING_BYTES = 64 << 10
_UTC_TIME = re.compile(r"\d{4}-\d\d-\d\dT[\d:.]+Z", re.ASCII)
# Time within which a killed process must end, s.
KILL_TIMEOUT_S = 1.0
# Number of bytes of an answer in one read.
READ_CHUNK_BYTES = 64 << 10
# Largest length of a message about a plug-in, characters.
MAX_REASON_CHARACTERS = 200
_HOST_COMMAND = (
    *(sys.executable, "-P", "-c"),
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from topdress.drivers.plugin_host import run_plugin_host as run; run(*sys.argv[2:])",
)


class PluginProcess:
    """Runs the process of a plug-in. One thread sends requests at a time; any thread may end the
    process."""

    def __init__(self, group: Group, name: str) -> None:
        """Starts the process. Raises PluginFault where that fails."""
        self._group, self._name = group, name
        self._is_late = False
        self._asks = threading.Lock()
        try:
            # The pipes are unbuffered, because a thread cannot close a buffered pipe in which
            # another thread waits.
            self._process = subprocess.Popen(
                [*_HOST_COMMAND, json.dumps(sys.path), f"topdress.{group}", name],
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError as error:
            raise self._make_fault(f"its process does not start: {error.strerror}") from None

    def send_request(self, limit_s: float, do: str, **values: Any) -> Any:
        """Returns the plug-in's answer. Raises PluginFault, also where the answer takes longer than
        `limit_s` seconds."""
        watch = threading.Timer(limit_s, self._end_late_process)
        watch.daemon = True
        watch.start()
        try:
            with self._asks:
                line = self._exchange_lines(json.dumps({"do": do, **values}).encode() + b"\n")
        # The process has ended, or was ended during the request.
        except (OSError, ValueError):
            line = b""
        finally:
            watch.cancel()
        if self._is_late:
            raise self._make_fault(f"no answer to {do} within {limit_s:g} s")
        return self._read_answer(do, line)

    def end_process(self) -> None:
        """Ends the process and its children."""
        with suppress(OSError):
            self._kill_process()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(KILL_TIMEOUT_S)
        if self._asks.acquire(blocking=False):
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
            self._asks.release()

    def _exchange_lines(self, request: bytes) -> bytes:
        """Sends a line and returns the line of the answer. Raises OSError, ValueError,
        PluginFault."""
        assert self._process.stdin is not None and self._process.stdout is not None
        rest = memoryview(request)
        while rest:
            rest = rest[self._process.stdin.write(rest) or 0 :]
        pieces, count = list[bytes](), 0
        while piece := os.read(self._process.stdout.fileno(), READ_CHUNK_BYTES):
            pieces.append(piece)
            count += len(piece)
            if count > MAX_ANSWER_BYTES:
                raise self._make_fault(f"gives more than {MAX_ANSWER_BYTES >> 20} MB")
            if piece.endswith(b"\n"):
                break
        return b"".join(pieces)

    def _read_answer(self, do: str, line: bytes) -> Any:
        try:
            answer = json.loads(line)
            if "gives" in answer:
                return answer["gives"]
            why = str(answer["raises"])
        except (ValueError, KeyError, TypeError, RecursionError):
            raise self._make_fault("its process ended by itself") from None
        raise self._make_fault(f"not loaded: {why}" if do in ("load", "make") else why)

    def _end_late_process(self) -> None:
        self._is_late = True
        with suppress(OSError):
            self._kill_process()

    def _kill_process(self) -> None:
        if os.name == "posix":
            os.killpg(self._process.pid, signal.SIGKILL)
        else:
            self._process.kill()

    def _make_fault(self, why: str) -> PluginFault:
        return PluginFault(self._group, self._name, join_lines(why)[:MAX_REASON_CHARACTERS])


def describe_plugin(group: Group, name: str) -> Plugin:
    """Returns the type and values of a plug-in. Raises PluginFault."""
    process = PluginProcess(group, name)
    try:
        found = process.send_request(LOAD_TIMEOUT_S, "load")
        return Plugin(name, str(found["is_a"]), dict(found["values"]))
    finally:
        process.end_process()


def read_format(name: str, path: Path) -> Any:
    """Returns the content of a file, read by the plug-in of its format, as plain data. Raises
    PluginFault."""
    process = PluginProcess("formats", name)
    try:
        process.send_request(LOAD_TIMEOUT_S, "load")
        return process.send_request(FORMAT_TIMEOUT_S, "read", path=str(path))
    finally:
        process.end_process()


class PluginDecoder:
    """Decodes recordings by a plug-in's receiver and waits for each answer."""

    def __init__(self, name: str) -> None:
        """Starts the plug-in. Raises PluginFault."""
        self.counts = Counts()
        self._name = name
        self._process = PluginProcess("devices", name)
        for do in ("load", "make"):
            self._send_request(LOAD_TIMEOUT_S, do)

    def feed(self, data: bytes, time_s: float) -> list[GnssFix]:
        """Returns the fixes that these bytes complete. Raises PluginFault."""
        return self._read_fixes(
            self._send_request(
                FEED_TIMEOUT_S, "feed", data=data.decode(JSON_BYTES_ENCODING), time_s=time_s
            )
        )

    def flush(self, time_s: float) -> list[GnssFix]:
        """Returns the fixes that the end of a recording completes. Raises PluginFault."""
        return self._read_fixes(self._send_request(FEED_TIMEOUT_S, "flush", time_s=time_s))

    def close(self) -> None:
        """Ends the plug-in's process."""
        self._process.end_process()

    def _send_request(self, limit_s: float, do: str, **values: Any) -> Any:
        try:
            return self._process.send_request(limit_s, do, **values)
        except PluginFault:
            self.close()
            raise

    def _read_fixes(self, given: Any) -> list[GnssFix]:
        try:
            counts = given["counts"]
            self.counts = Counts(
                int(counts["read"]),
                int(counts["accepted"]),
                _read_kind_counts(counts["rejected"]),
                _read_kind_counts(counts["ignored"]),
            )
            return [_read_fix(values) for values in given["fixes"]]
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            self.close()
            why = join_lines(f"gives what is no list of GnssFix with counts: {error}")
            raise PluginFault("devices", self._name, why[:MAX_REASON_CHARACTERS]) from None


class PluginReceiver:
    """Decodes a line in a cab by a plug-in's receiver without waiting: the fixes of some bytes are
    returned by a later call."""

    def __init__(self, name: str) -> None:
        self.counts = Counts()
        self._name = name
        self._session: _DecoderSession | None = None

    def feed(self, data: bytes, time_s: float) -> list[GnssFix]:
        """Returns the fixes that arrived since the last call; called at every tick.

        Raises PluginFault; the next call starts a new process.
        """
        if self._session is None:
            self._session = _DecoderSession(self._name)
        session = self._session
        if data:
            session.put_bytes(data, time_s)
        fixes, counts = session.take_fixes()
        if counts is not None:
            # The counts are updated in place, because the device's line holds a reference to them.
            self.counts.read, self.counts.accepted = counts.read, counts.accepted
            self.counts.rejected, self.counts.ignored = counts.rejected, counts.ignored
        if session.fault is not None:
            self._session = None
            raise session.fault
        return fixes

    def close(self) -> None:
        """Ends the plug-in's process."""
        session, self._session = self._session, None
        if session is not None:
            session.end_session()


class _DecoderSession:
    """Runs a plug-in's decoder in a thread, with queues for its input and output."""

    def __init__(self, name: str) -> None:
        self.fault: PluginFault | None = None
        self._name = name
        self._pieces: deque[tuple[bytes, float]] = deque()
        self._waiting_bytes = 0
        self._given: deque[tuple[list[GnssFix], Counts]] = deque()
        self._changed = threading.Condition()
        self._is_ended = False
        self._decoder: PluginDecoder | None = None
        threading.Thread(target=self._run_session, name=f"plug-in {name}", daemon=True).start()

    def put_bytes(self, data: bytes, time_s: float) -> None:
        """Queues bytes; where the plug-in is too slow the oldest bytes are dropped."""
        with self._changed:
            self._pieces.append((data, time_s))
            self._waiting_bytes += len(data)
            while self._waiting_bytes > MAX_WAITING_BYTES:
                self._waiting_bytes -= len(self._pieces.popleft()[0])
            self._changed.notify()

    def take_fixes(self) -> tuple[list[GnssFix], Counts | None]:
        """Returns the fixes that arrived, and the newest counts; None where no answer arrived."""
        given = [self._given.popleft() for _ in range(len(self._given))]
        return [fix for fixes, _ in given for fix in fixes], given[-1][1] if given else None

    def end_session(self) -> None:
        """Ends the thread and the process."""
        with self._changed:
            self._is_ended = True
            self._changed.notify()
        if self._decoder is not None:
            self._decoder.close()

    def _run_session(self) -> None:
        try:
            self._decoder = PluginDecoder(self._name)
            while (piece := self._wait_for_piece()) is not None:
                fixes = self._decoder.feed(*piece)
                self._given.append((fixes, self._decoder.counts))
            self._decoder.close()
        except PluginFault as fault:
            self.fault = fault

    def _wait_for_piece(self) -> tuple[bytes, float] | None:
        """Returns the next bytes with their time; None means that the session must end."""
        with self._changed:
            while not self._pieces and not self._is_ended:
                self._changed.wait()
            if self._is_ended:
                return None
            piece = self._pieces.popleft()
            self._waiting_bytes -= len(piece[0])
            return piece


@cache
def _list_fix_types() -> tuple[tuple[type, ...], ...]:
    """Returns the permitted types of each value of a fix."""
    return tuple(get_args(hint) or (hint,) for hint in get_type_hints(GnssFix).values())


def _read_fix(values: Any) -> GnssFix:
    """Returns a fix made of plain values, each of its permitted type. Raises ValueError,
    TypeError."""
    read = [
        _convert_type(value, types) for value, types in zip(values, _list_fix_types(), strict=True)
    ]
    fix = GnssFix(*read)
    if not isfinite(fix.time_s):
        raise ValueError(f"time_s {fix.time_s}")
    if fix.utc is not None and not _UTC_TIME.fullmatch(fix.utc):
        raise ValueError(f"utc {fix.utc}")
    if fix.utc is not None:
        datetime.fromisoformat(fix.utc)
    return fix


def _convert_type(value: Any, types: tuple[type, ...]) -> Any:
    if value is None and NoneType in types:
        return None
    if types[0] is str and isinstance(value, str):
        return value
    if types[0] in (int, float) and isinstance(value, (int, float)):
        return types[0](value)
    raise TypeError(f"{value!r}, allowed is {types[0].__name__}")


def _read_kind_counts(given: Any) -> Counter[str]:
    return Counter({str(kind): int(times) for kind, times in given.items()})
