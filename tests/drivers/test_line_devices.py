"""A device with a line of its own: what its file declares is used by the cab file, the cab,
recognition, decode, the screen and the docs."""

from __future__ import annotations

from pathlib import Path

import pytest
from topdress.console.app.pages.job.checklist import DEVICE_NAMES
from topdress.console.locale.po_reader import read_po
from topdress.control.readings import Measurements
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.decode import decode_capture
from topdress.drivers.devices.device import LineDevice
from topdress.drivers.devices.protocol_probe import recognise_protocol
from topdress.drivers.devices.registry import list_devices, list_line_devices
from topdress.drivers.ports import make_memory_pair

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
