"""Defines the keys of the Devices page; all act on the picked device."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app.action import DEVICES, Action, set_page
from topdress.console.frame import DeviceDo
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.devices.page import DevicesScreen


def toggle_capture(page: DevicesScreen) -> None:
    """Begin a capture of raw bytes, or end it."""
    device = page.picked_device
    page.send_device_order(
        device, DeviceDo.END_CAPTURE if device.capture_path else DeviceDo.CAPTURE
    )


def toggle_plugged(page: DevicesScreen) -> None:
    """Connect the device, or disconnect it after a question."""
    device = page.picked_device
    # Only disconnecting can interrupt work, so only disconnecting is asked.
    if device.plugged:
        page.app.ask_yes_no(
            _("Disconnect {device}?").format(device=device.name),
            _("It stays disconnected until C connects it again; work may stop without it."),
            lambda: page.send_device_order(device, DeviceDo.DISCONNECT),
        )
    else:
        page.send_device_order(device, DeviceDo.CONNECT)


ACTIONS = set_page(
    DEVICES,
    Action(
        "dev_up",
        "up",
        "Up",
        N_("device above"),
        N_("Picks the device above."),
        lambda page: page.move_mark(-1),
    ),
    Action(
        "dev_down",
        "down",
        "Down",
        N_("device below"),
        N_("Picks the device below."),
        lambda page: page.move_mark(1),
    ),
    # A test sends nothing, so it is harmless on a port with an unknown device.
    Action(
        "dev_test",
        "enter",
        "Enter",
        N_("test"),
        N_("Listens to what is on this port; nothing is sent."),
        lambda page: page.send_device_order(page.picked_device, DeviceDo.TEST),
        bar=4,
        needs_machine=True,
    ),
    Action(
        # A raw capture serves reports of protocol faults.
        "dev_capture",
        "e",
        "E",
        N_("write raw"),
        N_("Records what is received and sent in a file next to the log; again: stops."),
        toggle_capture,
        bar=5,
        needs_machine=True,
    ),
    Action(
        "dev_plug",
        "c",
        "C",
        N_("connect / disconnect"),
        N_(
            "Connects or disconnects the port; disconnecting asks first and is refused "
            "while working."
        ),
        toggle_plugged,
        bar=6,
        needs_machine=True,
    ),
)
