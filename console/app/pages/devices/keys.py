"""Keys of the Devices page and what they do, all to the device that is picked."""
from __future__ import annotations

from typing import TYPE_CHECKING

from console.app.action import DEVICES, Action
from console.app.dialogs import Confirm
from console.frame import DeviceDo, DeviceView
from console.locale import N_, _

if TYPE_CHECKING:
    from console.app.pages.devices.page import DevicesScreen


def above(page: DevicesScreen) -> None:
    page.move(-1)


def below(page: DevicesScreen) -> None:
    page.move(1)


def test(page: DevicesScreen) -> None:
    page.order(page.picked_device, DeviceDo.TEST)


def write_raw(page: DevicesScreen) -> None:
    device = page.picked_device
    page.order(device, DeviceDo.END_CAPTURE if device.capture_path else DeviceDo.CAPTURE)


def plug(page: DevicesScreen) -> None:
    device = page.picked_device
    if device.plugged:
        _ask_disconnect(page, device)
    else:
        page.order(device, DeviceDo.CONNECT)


def _ask_disconnect(page: DevicesScreen, device: DeviceView) -> None:
    def answer(yes: bool | None) -> None:
        if yes:
            page.order(device, DeviceDo.DISCONNECT)

    page.app.push_screen(Confirm(_("Disconnect {device}?").format(device=device.name),
                                 _("It stays disconnected until C connects it again; work may stop without it.")),
           answer)


ACTIONS = (
    Action("dev_up", "up", "Up", N_("device above"), N_("Picks the device above."), above, DEVICES),
    Action("dev_down", "down", "Down", N_("device below"), N_("Picks the device below."), below, DEVICES),
    Action("dev_test", "enter", "Enter", N_("test"), N_("Listens to what is on this port; nothing is sent."), test,
           DEVICES, 4),
    Action("dev_capture", "e", "E", N_("write raw"),
           N_("Records what is received and sent in a file next to the log; again: stops."), write_raw, DEVICES, 5),
    Action("dev_plug", "c", "C", N_("connect / disconnect"),
           N_("Connects or disconnects the port; disconnecting asks first and is refused while working."), plug,
           DEVICES,
           6),
)
