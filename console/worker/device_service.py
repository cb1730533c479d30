"""What is ordered of single devices: connect, disconnect, listen what speaks there, capture
what comes and goes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from topdress.console.frame import DeviceDo, DeviceTest
from topdress.console.worker.limits import CAPTURE_BYTES, TEST_S
from topdress.console.worker.parts import Bench
from topdress.console.worker.requests import DeviceOrder
from topdress.console.worker.side_files import SideFiles
from topdress.control.orders import Answer, State
from topdress.drivers.cab_line import DeviceLine, Direction
from topdress.drivers.devices import capture, probe
from topdress.drivers.ports import Clock, Port, open_port

BUSY = (State.WORKING, State.CALIBRATING)
Opener = Callable[[str, int, Clock], Port]


class DeviceService:
    """For all devices of a bench. `tick` is called once a tick; nothing here blocks."""

    def __init__(
        self,
        bench: Bench,
        log_path: str,
        files: SideFiles,
        opener: Opener = open_port,
        capture_bytes: int = CAPTURE_BYTES,
    ) -> None:
        self._bench, self._files, self._opener, self._capture_bytes = (
            bench,
            files,
            opener,
            capture_bytes,
        )
        self._stem = Path(log_path).with_suffix("") if log_path else None
        self._captures: dict[str, _Capture] = {}
        self._started = 0
        self._tests: dict[str, _Test] = {}

    def order(self, order: DeviceOrder, now_s: float, state: str | None) -> Answer:
        """Obey or refuse; `state` of the newest tick."""
        name = order.device
        line = self._bench.line(name)
        if line is None:
            return Answer(False, f"no_such_device;device={name.replace(';', ' ')}")
        if order.do is DeviceDo.DISCONNECT and state in BUSY:
            return Answer(False, f"device_in_use;state={state}")
        if order.do in (DeviceDo.CONNECT, DeviceDo.DISCONNECT):
            line.plug(order.do is DeviceDo.CONNECT)
            return Answer(True)
        if order.do is DeviceDo.TEST:
            return self._begin_test(line, now_s)
        return (
            self._begin_capture(line) if order.do is DeviceDo.CAPTURE else self._end_capture(name)
        )

    def tick(self, now_s: float, state: str | None) -> None:
        for test in self._tests.values():
            test.tick(now_s, state in BUSY)
        for name in [
            name for name, one in self._captures.items() if one.size >= self._capture_bytes
        ]:
            self._end_capture(name)

    def test(self, name: str) -> DeviceTest | None:
        found = self._tests.get(name)
        return found.result if found else None

    def capture_path(self, name: str) -> str:
        found = self._captures.get(name)
        return str(found.path) if found else ""

    def _begin_test(self, line: DeviceLine, now_s: float) -> Answer:
        if not line.plugged:
            return Answer(False, f"device_disconnected;device={line.name}")
        running = self._tests.get(line.name)
        if running is None or not running.result.running:
            self._tests[line.name] = _Test(line, now_s, self._opener)
        return Answer(True)

    def _begin_capture(self, line: DeviceLine) -> Answer:
        if self._stem is None:
            return Answer(False, "no_log")
        if line.name not in self._captures:
            self._started += 1
            path = self._stem.with_name(f"{self._stem.name}.{line.name}.{self._started}.capture")
            self._captures[line.name] = _Capture(line, path, self._files)
        return Answer(True)

    def _end_capture(self, name: str) -> Answer:
        found = self._captures.pop(name, None)
        if found is not None:
            found.end()
        return Answer(True)


class _Capture:
    def __init__(self, line: DeviceLine, path: Path, files: SideFiles) -> None:
        self.path = path
        self.size = 0
        self._line, self._files = line, files
        status = line.status(0.0)
        files.append(path, capture.header(line.name, status.protocol, status.port))
        line.listen_in(self._take)

    def end(self) -> None:
        self._line.leave(self._take)

    def _take(self, now_s: float, direction: Direction, data: bytes) -> None:
        written = capture.captured(now_s, direction, data)
        self.size += len(written)
        self._files.append(self.path, written)


class _Test:
    """Listens on the line as it is; where nothing is understood and the line is serial, at
    other rates too.

    Deciding what the bytes are takes long, so a thread does it. Other rates need the port: for
    these seconds the device is off, which is left out while the machine works.
    """

    def __init__(self, line: DeviceLine, now_s: float, opener: Opener) -> None:
        self.result = DeviceTest(True)
        self._line, self._opener = line, opener
        self._until_s = now_s + TEST_S
        self._heard: list[bytes] = []
        self._listening = True
        line.listen_in(self._take)

    def tick(self, now_s: float, busy: bool) -> None:
        if not self._listening or now_s < self._until_s:
            return
        self._listening = False
        self._line.leave(self._take)
        threading.Thread(
            target=self._decide,
            args=(not busy and self._line.baud is not None,),
            name=f"test of {self._line.name}",
            daemon=True,
        ).start()

    def _take(self, now_s: float, direction: Direction, data: bytes) -> None:
        if direction == "<":
            self._heard.append(data)

    def _decide(self, other_rates: bool) -> None:
        found = probe.recognise_either(self._heard)
        if not found.protocol and other_rates:
            found = self._at_other_rates()
        if not found.protocol and not found.said:
            state = self._line.port.state()
            found = found._replace(said=state.last_error or (state.last_lines() or ["silent"])[-1])
        self.result = DeviceTest(
            False, found.protocol, found.baud, found.accepted, found.rejected, found.said
        )

    def _at_other_rates(self) -> probe.ProbeFinding:
        line = self._line
        line.port.plug(False)
        try:
            return probe.probe(
                lambda baud: self._opener(line.port.name, baud, time.monotonic),
                [baud for baud in probe.BAUDS if baud != line.baud],
            )
        except (OSError, ValueError) as error:
            return probe.ProbeFinding(said=str(error))
        finally:
            line.port.plug(line.plugged)
