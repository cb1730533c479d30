"""What is ordered of single devices, on memory lines and an injected clock."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
from topdress.console.frame import DeviceDo, DeviceTest
from topdress.console.worker import device_service
from topdress.console.worker.device_service import DeviceService
from topdress.console.worker.requests import DeviceOrder
from topdress.console.worker.side_files import SideFiles
from topdress.drivers.cab_line import DeviceLine
from topdress.drivers.devices.capture import extract_received
from topdress.drivers.devices.lines import Counts
from topdress.drivers.ports import make_memory_pair

HEAD = b"0,0.5,0.512,0.61,0\r\n"


@pytest.fixture
def made(tmp_path):
    """A desk with one device: `head_1` on a memory line."""
    host, device = make_memory_pair("head_1")
    line = DeviceLine("head_1", "greenseeker", host, Counts())
    bench = SimpleNamespace(find_device_line=lambda name: line if name == "head_1" else None)
    files = SideFiles()
    made = SimpleNamespace(
        line=line,
        device=device,
        files=files,
        now_s=0.0,
        opened=[],
        desk=DeviceService(
            bench, str(tmp_path / "run.csv"), files, lambda *a: made.opener(*a), 1_000
        ),
    )

    def order(do, state="ready", name="head_1"):
        return made.desk.obey_device_order(DeviceOrder(name, do), made.now_s, state)

    def run(seconds, state="ready", said=b""):
        for _ in range(round(seconds / 0.05)):
            made.now_s += 0.05
            if said:
                device.write(said)
            line.read_bytes(made.now_s)
            made.desk.end_due_work(made.now_s, state)

    made.order, made.run = order, run
    yield made
    files.close_files()


def settled(made):
    until = time.monotonic() + 5.0
    while made.desk.find_test_result("head_1").running:
        assert time.monotonic() < until
        time.sleep(0.005)
    return made.desk.find_test_result("head_1")


def test_an_unknown_device_is_named(made):
    assert made.order(DeviceDo.TEST, name="tail;1") == (
        False,
        "no_such_device;device=tail 1",
    )


def test_disconnect_and_connect(made):
    assert made.order(DeviceDo.DISCONNECT).accepted
    made.run(0.2, said=HEAD)
    status = made.line.make_status(made.now_s)
    assert (status.connected, status.last_error, status.bytes_in, made.line.plugged) == (
        False,
        "unplugged",
        0,
        False,
    )
    assert made.order(DeviceDo.TEST) == (False, "device_disconnected;device=head_1")
    assert made.order(DeviceDo.CONNECT).accepted
    made.run(0.2, said=HEAD)
    status = made.line.make_status(made.now_s)
    assert status.connected and status.bytes_in > 0 and status.connects == 2 and made.line.plugged


@pytest.mark.parametrize("state", ["working", "calibrating"])
def test_nothing_is_disconnected_under_work(made, state):
    assert made.order(DeviceDo.DISCONNECT, state) == (
        False,
        f"device_in_use;state={state}",
    )
    assert made.line.plugged


def test_a_capture_holds_what_came_and_went_with_times(made, tmp_path):
    made.run(0.1, said=HEAD)
    assert made.order(DeviceDo.CAPTURE).accepted
    path = tmp_path / "run.head_1.1.capture"
    assert made.desk.find_capture_path("head_1") == str(path)
    made.run(0.1, said=HEAD)
    made.line.write_bytes(made.now_s, b"?\r\n")
    assert made.order(DeviceDo.CAPTURE).accepted, "again: the same one goes on"
    made.run(0.05, said=b"ha")
    assert made.order(DeviceDo.END_CAPTURE).accepted
    made.run(0.1, said=HEAD)
    made.files.close_files()
    text = path.read_bytes()
    assert text.decode().splitlines() == [
        "# topdress-capture/1 head_1 greenseeker head_1:host",
        "0.150 < 0,0.5,0.512,0.61,0\\r\\n",
        "0.200 < 0,0.5,0.512,0.61,0\\r\\n",
        "0.200 > ?\\r\\n",
        "0.250 < ha",
    ]
    assert extract_received(text) == HEAD * 2 + b"ha"
    assert made.desk.find_capture_path("head_1") == ""
    made.order(DeviceDo.CAPTURE)
    assert made.desk.find_capture_path("head_1").endswith("run.head_1.2.capture"), (
        "the one before stays as it is"
    )


def test_a_capture_ends_by_itself_before_it_fills_the_disk(made, tmp_path):
    made.order(DeviceDo.CAPTURE)
    made.run(5.0, said=HEAD)
    assert made.desk.find_capture_path("head_1") == ""
    made.files.close_files()
    assert 1_000 <= (tmp_path / "run.head_1.1.capture").stat().st_size < 1_100


def test_a_capture_that_cannot_be_written_is_told_and_stops_nothing(made, tmp_path):
    (tmp_path / "run.head_1.1.capture").mkdir()
    made.order(DeviceDo.CAPTURE)
    made.run(0.2, said=HEAD)
    made.files.close_files()
    assert "run.head_1.1.capture" in made.files.trouble


def test_a_test_says_what_speaks_there(made):
    assert made.order(DeviceDo.TEST).accepted
    assert made.desk.find_test_result("head_1") == DeviceTest(True)
    made.run(1.4, said=HEAD)
    assert made.desk.find_test_result("head_1").running
    made.run(0.2, said=HEAD)
    found = settled(made)
    assert (found.protocol, found.baud, found.rejected, found.said) == (
        "greenseeker",
        None,
        0,
        HEAD.decode().strip(),
    )
    assert found.accepted >= 29 and made.line.port.state().connects == 1, "the line was not touched"


def test_a_silent_line_is_silent(made):
    made.order(DeviceDo.TEST)
    made.run(1.6)
    assert settled(made) == DeviceTest(False, said="silent")


@pytest.mark.parametrize(
    ("state", "found"), [("ready", ("greenseeker", 9600)), ("working", ("", None))]
)
def test_a_serial_line_is_tried_at_other_rates_but_not_under_work(made, monkeypatch, state, found):
    """What comes at the configured rate is rubbish; at 9600 Bd it is a head."""
    monkeypatch.setattr(
        device_service.protocol_probe.probe_port, "__defaults__", (time.monotonic, time.sleep, 0.1)
    )
    made.line.baud = 38400
    plugged = []

    def opener(name, baud, clock):
        plugged.append((name, made.line.port.state().last_error))
        host, device = make_memory_pair(name)
        device.write(HEAD * 5 if baud == 9600 else b"\x80\x91\xff" * 20)
        return host

    made.opener = opener
    made.order(DeviceDo.TEST)
    made.run(1.6, state=state, said=b"\x80\x91\xff")
    result = settled(made)
    assert (result.protocol, result.baud) == found
    if state == "working":
        assert not plugged and result.said
    else:
        assert set(plugged) == {("head_1:host", "unplugged")}, (
            "one program at a time has a serial port"
        )
    assert made.line.port.state().connected, "and it is given back"
