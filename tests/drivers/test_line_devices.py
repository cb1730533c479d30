"""A device with a line of its own: what its file declares is used by the cab file, the cab,
recognition, decode, the screen and the docs."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest
from topdress.console.app.pages.job.checklist import DEVICE_NAMES
from topdress.console.locale.po_reader import read_po
from topdress.control.field.job import Job
from topdress.control.machine.machine import Machine
from topdress.control.readings import AnnouncedSpeeds, Measurements
from topdress.control.simulation.plant import Plant
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.decode import decode_capture
from topdress.drivers.devices.device import LineDevice
from topdress.drivers.devices.protocol_probe import recognise_protocol
from topdress.drivers.devices.registry import list_devices, list_line_devices
from topdress.drivers.devices.tractor_speed import make_speed_sentence
from topdress.drivers.ports import Port, make_memory_pair, open_port
from topdress.drivers.virtual import served_machine

from tests.waiting import wait_for

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("one", list_line_devices(), ids=lambda one: one.section)
def test_a_device_is_taken_from_its_file(one: LineDevice) -> None:
    data = one.make_example()
    decoder = one.make_decoder(None)
    messages = decoder.feed(data, 0.0)
    assert len(messages) == decoder.counts.accepted == 40 and not decoder.counts.rejected
    assert recognise_protocol(data).protocol == (one.heard_as or one.section)
    found = [one.find_measurements(message) for message in messages]
    fields = {name for values in found for name, value in values.items() if value is not None}
    assert fields <= {*Measurements._fields}
    if one.make_record is not None:
        records, counts = decode_capture(one.section, data)
        assert len(records) == counts.accepted == 40 and all(records)

    host, device = make_memory_pair("line", lambda: 0.0)
    config = CabConfig.model_validate({one.section: {"port": "memory"}})
    cab = Cab(config, lambda: 0.0, lambda url, baud, clock: host)
    device.write(data)
    measured = cab.read_measurements(0.0)
    assert all(getattr(measured, name) is not None for name in fields)
    [status] = cab.list_device_status(0.0)
    assert (status.name, status.protocol, status.accepted) == (one.section, one.protocol, 40)


def test_the_virtual_machine_serves_the_lines_that_devices_declare(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    speed = next(one for one in list_line_devices() if one.section == "tractor")
    plan = AnnouncedSpeeds(0.0, ((0.0, 1.2), (1.5, 2.0)), 0.5)
    own = replace(speed, make_message=lambda sensed: make_speed_sentence(plan))
    found = [own, *(one for one in list_line_devices() if one.make_message is not None)]
    monkeypatch.setattr(served_machine, "list_line_devices", lambda: found)
    now_s = [0.0]
    options = served_machine.ServeOptions(first_port=0)
    machine = served_machine.ServedMachine(
        Plant(Machine(), Job(), 1, 0.05), options, lambda: now_s[0]
    )
    try:
        addresses = {one.device: one for one in machine.addresses}
        for one in found:
            assert addresses[one.section].protocol == one.protocol
            port = open_port(addresses[one.section].url, 115200, time.monotonic)
            data = b""

            def heard(one: LineDevice = one, port: Port = port) -> bool:
                nonlocal data
                now_s[0] += 0.05
                machine.advance_plant()
                data += port.read()
                return one.make_decoder(None).feed(data, 0.0) != []

            wait_for(heard)
            port.close()
    finally:
        machine.close()


def test_a_device_has_its_name_and_its_place_in_the_docs() -> None:
    page = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")
    texts = {
        text: chinese
        for path in (ROOT / "console" / "locale" / "zh").glob("*.po")
        for text, chinese in read_po(path.read_text(encoding="utf-8")).items()
    }
    for one in list_devices():
        assert f"`{one.section}:`" in page, f"docs/devices.md: {one.section}"
        assert DEVICE_NAMES[one.section] == one.title and texts.get(one.title), one.title
