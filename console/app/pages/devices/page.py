"""Shows the Devices screen: every port of the machine, what it receives, and the actions on it."""

from __future__ import annotations

from collections import deque
from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Vertical
from topdress.console.app.action import DEVICES, Action, make_bindings
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.devices.device_table import DeviceTable, TableView
from topdress.console.app.pages.devices.device_view import (
    make_detail_rows,
    make_device_lines,
    make_effort_row,
    make_raw_rows,
)
from topdress.console.app.pages.devices.keys import ACTIONS
from topdress.console.app.pages.devices.labelled_rows import LabelledRows, RowsView
from topdress.console.app.panel_views import RunView
from topdress.console.app.widgets.action_chips import ActionChip, Chips
from topdress.console.app.widgets.base_panel import Picked
from topdress.console.frame import DeviceDo, DeviceView, Frame
from topdress.console.locale import _
from topdress.control.readings import NO_EFFORT_FINDING

# Raw lines stored per device; more do not fit on a screen.
MAX_RAW_LINES = 40


class DevicesScreen(Page):
    """Shows the devices."""

    where: ClassVar[str] = DEVICES
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        # Name of the picked device: names stay valid when the list of devices changes, indices do
        # not.
        self.picked = ""
        self._raw: dict[str, deque[tuple[float, str]]] = {}

    def compose_body(self) -> ComposeResult:
        with Vertical(id="devices"):
            yield DeviceTable(TableView((), 0), id="device-table")
            yield LabelledRows(RowsView("", ()), id="device-effort")
            yield LabelledRows(RowsView("", ()), id="device-details")
            yield LabelledRows(RowsView("", ()), id="device-raw")
            yield Chips((), id="device-chips")

    @property
    def devices(self) -> tuple[DeviceView, ...]:
        """Devices of the newest frame."""
        frame, _age_s = self.find_frame(self.app.clock())
        return frame.devices if frame is not None else ()

    @property
    def chosen_device(self) -> DeviceView | None:
        """Picked device, else the first device."""
        devices = self.devices
        return next(
            (one for one in devices if one.name == self.picked), devices[0] if devices else None
        )

    def gather_frame(self, frame: Frame) -> None:
        """Store the last raw lines of every device."""
        for one in frame.devices:
            lines = self._raw.setdefault(one.name, deque(maxlen=MAX_RAW_LINES))
            if one.last_raw and (not lines or lines[-1][1] != one.last_raw):
                lines.append((frame.row.time_s, one.last_raw))

    def show_numbers(self, view: RunView) -> None:
        """Show devices and details."""
        super().show_numbers(view)
        frame, age_s = self.find_frame(self.app.clock())
        effort = make_effort_row(NO_EFFORT_FINDING if frame is None else frame.effort, age_s)
        self.query_one("#device-effort", LabelledRows).show_view(effort)
        self.query_one("#device-effort").display = bool(effort.rows)
        self.query_one("#device-details").set_class(bool(effort.rows), "-under-effort")
        device, devices = self.chosen_device, self.devices
        at = devices.index(device) if device is not None else 0
        self.query_one("#device-table", DeviceTable).show_view(
            TableView(make_device_lines(devices, age_s), at)
        )
        # The table leaves at least 16 rows to details, raw lines and the bars.
        self.query_one("#device-table").styles.height = min(
            len(devices) + 1, max(4, self.size.height - 16)
        )
        if device is None:
            empty = RowsView("", ())
            self.query_one("#device-details", LabelledRows).show_view(empty)
            self.query_one("#device-raw", LabelledRows).show_view(empty)
        else:
            about = make_detail_rows(device, age_s)
            self.query_one("#device-details", LabelledRows).show_view(about)
            self.query_one("#device-details").styles.height = len(about.rows) + 1
            raw = self.query_one("#device-raw", LabelledRows)
            lines = list(self._raw.get(device.name, ()))[-max(1, raw.size.height - 1) :]
            raw.show_view(make_raw_rows(lines))
        self.query_one("#device-chips", Chips).show_view(self._list_chips(device))

    def _list_chips(self, device: DeviceView | None) -> tuple[ActionChip, ...]:
        """Return the keys, with those that can be pressed now."""
        on = device is not None and not self.app.locked
        capturing = device is not None and bool(device.capture_path)
        testing = device is not None and device.test is not None and device.test.running
        plugged = device is None or device.plugged
        return (
            ActionChip("dev_up", "Up", _("above"), on),
            ActionChip("dev_down", "Down", _("below"), on),
            ActionChip(
                "dev_test",
                "Enter",
                _("listening") if testing else _("test"),
                on and plugged and not testing,
            ),
            ActionChip(
                "dev_capture",
                "E",
                _("end the raw file") if capturing else _("write raw to a file"),
                on,
                lead=capturing and on,
            ),
            ActionChip(
                "dev_plug",
                "C",
                _("disconnect") if plugged else _("connect"),
                on,
                lead=not plugged and on,
            ),
        )

    # The following methods react to keys and clicks.

    def perform_action(self, action: Action) -> None:
        if self.chosen_device is None:
            self.app.show_notice(_("no machine is connected"))
        else:
            super().perform_action(action)

    @property
    def picked_device(self) -> DeviceView:
        """Picked device, for actions that need one."""
        assert self.chosen_device is not None
        return self.chosen_device

    def send_device_order(self, device: DeviceView, do: DeviceDo) -> None:
        """Send an order for a device."""
        self.app.run_worker(
            self.app.ask_source(lambda source: source.send_device_order(device.name, do)),
            group="orders",
            exit_on_error=False,
        )

    def move_mark(self, by: int) -> None:
        """Pick another device, beyond the ends continuing at the other end."""
        names = [one.name for one in self.devices]
        self.picked = names[(names.index(self.picked_device.name) + by) % len(names)]

    def on_picked(self, event: Picked) -> None:
        """Pick the clicked device."""
        devices = self.devices
        if event.index < len(devices):
            self.picked = devices[event.index].name
            self.app.show_changes()
