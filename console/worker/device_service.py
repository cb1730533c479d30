"""Executes orders for single devices: connect, disconnect, listen for a protocol, capture raw
bytes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from topdress.console.frame import DeviceDo, DeviceTest
from topdress.console.worker.limits import LISTEN_TEST_DURATION_S, MAX_CAPTURE_BYTES
from topdress.console.worker.requests import DeviceOrder
from topdress.console.worker.run_interfaces import MachineDevices
from topdress.console.worker.side_files import SideFiles
from topdress.control.orders import Answer, State
from topdress.drivers.cab_line import DeviceLine, Direction
from topdress.drivers.devices import capture, protocol_probe
from topdress.drivers.ports import Clock, Port, open_port

# A device must not be disconnected while the machine needs it.
DEVICE_BUSY_STATES = (State.WORKING, State.CALIBRATING)
PortOpener = Callable[[str, int, Clock], Port]
# Runs named work outside of the loop.
RunAside = Callable[[Callable[[], None], str], None]


def run_in_thread(do: Callable[[], None], name: str) -> None:
    """Run work in a thread, which does not prevent the end of the worker."""
    threading.Thread(target=do, name=name, daemon=True).start()


class DeviceService:
    """Connects, tests and captures all devices of a bench. `end_due_work` runs once a tick; nothing
    here blocks."""

    def __init__(
        self,
        bench: MachineDevices,
        log_path: str,
        files: SideFiles,
        opener: PortOpener = open_port,
        capture_bytes: int = MAX_CAPTURE_BYTES,
        run_aside: RunAside = run_in_thread,
    ) -> None:
        self._run_aside = run_aside
        self._bench, self._files, self._opener, self._capture_bytes = (
            bench,
            files,
            opener,
            capture_bytes,
        )
        self._stem = Path(log_path).with_suffix("") if log_path else None
        self._captures: dict[str, _LineCapture] = {}
        self._started = 0
        self._tests: dict[str, _LineTest] = {}

    def obey_device_order(self, order: DeviceOrder, now_s: float, state: str | None) -> Answer:
        """Execute or refuse an order for one device.

        Parameters
        ----------
        order
            Device and action.
        now_s
            Run time, s.
        state
            State of the loop at the newest tick.
        """
        name = order.device
        # The client names a device as the frame does.
        line = self._bench.find_device_line(name)
        if line is None:
            # A refusal separates its details by semicolons, so the name must contain none.
            return Answer(False, f"no_such_device;device={name.replace(';', ' ')}")
        if order.do is DeviceDo.DISCONNECT and state in DEVICE_BUSY_STATES:
            return Answer(False, f"device_in_use;state={state}")
        if order.do in (DeviceDo.CONNECT, DeviceDo.DISCONNECT):
            line.set_plugged(order.do is DeviceDo.CONNECT)
            return Answer(True)
        # A test takes its time; its result comes with the frames.
        if order.do is DeviceDo.TEST:
            return self._begin_device_test(line, now_s)
        return (
            self._begin_capture(line)
            if order.do is DeviceDo.CAPTURE
            else self._finish_capture(name)
        )

    def end_due_work(self, now_s: float, state: str | None) -> None:
        """End tests that have listened long enough, and captures that are full."""
        # Tests end by time, captures by size.
        for test in self._tests.values():
            test.end_listening(now_s, state in DEVICE_BUSY_STATES)
        for name in [
            name for name, one in self._captures.items() if one.size >= self._capture_bytes
        ]:
            self._finish_capture(name)

    def find_test_result(self, name: str) -> DeviceTest | None:
        """Return the result of a device's newest test; None without a test."""
        found = self._tests.get(name)
        return found.result if found else None

    def find_capture_path(self, name: str) -> str:
        """Return the file of a capture in progress; "" without a capture."""
        found = self._captures.get(name)
        return str(found.path) if found else ""

    def _begin_device_test(self, line: DeviceLine, now_s: float) -> Answer:
        """Begin a test of a device, unless one is in progress."""
        if not line.plugged:
            return Answer(False, f"device_disconnected;device={line.name}")
        running = self._tests.get(line.name)
        if running is None or not running.result.running:
            self._tests[line.name] = _LineTest(line, now_s, self._opener, self._run_aside)
        return Answer(True)

    def _begin_capture(self, line: DeviceLine) -> Answer:
        """Begin a capture in a file next to the log, unless one is in progress."""
        # Files of a run lie next to its log.
        if self._stem is None:
            return Answer(False, "no_log")
        if line.name not in self._captures:
            # The number makes the name unique within a run.
            self._started += 1
            path = self._stem.with_name(f"{self._stem.name}.{line.name}.{self._started}.capture")
            self._captures[line.name] = _LineCapture(line, path, self._files)
        return Answer(True)

    def _finish_capture(self, name: str) -> Answer:
        """End a capture."""
        # Ending a capture that does not exist is no error: two consoles may press the key.
        found = self._captures.pop(name, None)
        if found is not None:
            found.stop_listening()
        return Answer(True)


class _LineCapture:
    """Writes the bytes of a line to a capture file."""

    def __init__(self, line: DeviceLine, path: Path, files: SideFiles) -> None:
        self.path = path
        self.size = 0
        self._line, self._files = line, files
        # The header tells a reader which protocol the bytes have.
        status = line.make_status(0.0)
        files.queue_append(
            path, capture.make_capture_header(line.name, status.protocol, status.port)
        )
        # A tap sees the bytes of both directions without delaying them.
        line.add_tap(self._write_captured)

    def stop_listening(self) -> None:
        """Stop capturing."""
        self._line.remove_tap(self._write_captured)

    def _write_captured(self, now_s: float, direction: Direction, data: bytes) -> None:
        """Queue captured bytes for the file."""
        written = capture.make_capture_lines(now_s, direction, data)
        self.size += len(written)
        self._files.queue_append(self.path, written)


class _LineTest:
    """Listens on a line as it is; a serial line without a known protocol is then probed at other
    baud rates.

    Recognition takes long, so a thread performs it. Other baud rates need the port: the device is
    off for these seconds, so they are omitted while the machine works.
    """

    def __init__(
        self, line: DeviceLine, now_s: float, opener: PortOpener, run_aside: RunAside
    ) -> None:
        self.result = DeviceTest(True)
        self._run_aside = run_aside
        self._line, self._opener = line, opener
        self._until_s = now_s + LISTEN_TEST_DURATION_S
        self._heard: list[bytes] = []
        self._listening = True
        line.add_tap(self._collect_bytes)

    def end_listening(self, now_s: float, busy: bool) -> None:
        """End listening when its time is over, and start the recognition."""
        if not self._listening or now_s < self._until_s:
            return
        self._listening = False
        self._line.remove_tap(self._collect_bytes)
        other_rates = not busy and self._line.baud is not None
        self._run_aside(lambda: self._recognise_bytes(other_rates), f"test of {self._line.name}")

    def _collect_bytes(self, now_s: float, direction: Direction, data: bytes) -> None:
        """Collect received bytes."""
        if direction == "<":
            self._heard.append(data)

    def _recognise_bytes(self, other_rates: bool) -> None:
        """Recognise the protocol of the collected bytes; runs in a thread."""
        found = protocol_probe.recognise_either(self._heard)
        if not found.protocol and other_rates:
            found = self._probe_other_rates()
        if not found.protocol and not found.detail:
            # Without a protocol the last error or line is the only hint.
            state = self._line.port.state()
            found = found._replace(
                detail=state.last_error or (state.format_last_lines() or ["silent"])[-1]
            )
        self.result = DeviceTest(
            False, found.protocol, found.baud, found.accepted, found.rejected, found.detail
        )

    def _probe_other_rates(self) -> protocol_probe.ProbeFinding:
        """Probe the port at other baud rates, with the device unplugged meanwhile."""
        line = self._line
        # Two programs on one serial port would steal bytes from each other.
        line.port.plug(False)
        try:
            return protocol_probe.probe_port(
                lambda baud: self._opener(line.port.name, baud, time.monotonic),
                [baud for baud in protocol_probe.PROBE_BAUD_RATES if baud != line.baud],
            )
        except (OSError, ValueError) as error:
            return protocol_probe.ProbeFinding(detail=str(error))
        finally:
            line.port.plug(line.plugged)
