"""Words a frame's devices for the Devices screen. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from topdress.console.app.pages.devices.device_table import ShownDevice
from topdress.console.app.pages.devices.labelled_rows import DeviceRow, RowsView
from topdress.console.app.panel_views import MAX_FRESH_AGE_S, format_duration
from topdress.console.frame import DeviceView
from topdress.console.locale import N_, _
from topdress.control.readings import EffortFinding

# Longer ages, s, are displayed in minutes; below, one decimal of a second fits.
LONG_AGE_S = 99.95
# Width of the bar of effort, in cells.
EFFORT_BAR_CELLS = 20

# Words for the reasons of rejection that decoders count.
REJECTION_NAMES = {
    "garbage": N_("bytes before a frame"),
    "bad_crc": N_("wrong check sum"),
    "bad_checksum": N_("wrong check sum"),
    "missing_crc": N_("no check sum"),
    "wrong_length": N_("wrong length"),
    "overlong": N_("line too long"),
    "repeated_sequence": N_("sent twice"),
    "out_of_range": N_("number out of range"),
    "impossible_value": N_("impossible number"),
    "not_a_number": N_("not a number"),
    "unknown_frame": N_("unknown frame"),
    "unknown_message": N_("unknown message"),
}


def describe_state(device: DeviceView) -> tuple[str, str, str]:
    """Return symbol, word and level of a device's state."""
    # A device that an operator has disconnected is no fault.
    if not device.plugged:
        return "▯", _("DISCONNECTED"), "amber"
    # Without a port no line can come.
    if not device.connected:
        return "✖", _("NO LINE"), "red"
    if device.age_s is None:
        return "!", _("SILENT"), "amber"
    if device.age_s > MAX_FRESH_AGE_S:
        return "!", _("SILENT"), "amber"
    return "✔", _("speaks"), ""


def format_age(age_s: float | None) -> str:
    """Return an age (s) in words."""
    if age_s is None:
        return "--"
    return f"{age_s:.1f} s" if age_s < LONG_AGE_S else format_duration(age_s)


def make_device_lines(devices: Sequence[DeviceView], frame_age_s: float) -> tuple[ShownDevice, ...]:
    """Return one row per device; all rows are grey while the frame is stale."""
    old = frame_age_s > MAX_FRESH_AGE_S
    # One row per device, in the order of the cab file.
    lines = []
    for one in devices:
        symbol, word, level = describe_state(one)
        marks = " ".join(
            mark
            for mark, on in (
                (_("[raw file]"), bool(one.capture_path)),
                (_("[listening]"), one.test is not None and one.test.running),
            )
            if on
        )
        # In a stale frame the ages would stand still, so the frame's own age is added.
        age_s = None if one.age_s is None else one.age_s + (frame_age_s if old else 0.0)
        lines.append(
            ShownDevice(
                one.name,
                symbol,
                word,
                level,
                f"{one.rate_hz:.1f}",
                format_age(age_s),
                str(one.accepted),
                str(one.rejected),
                one.protocol,
                one.port,
                marks,
                old or one.age_s is None or one.age_s > MAX_FRESH_AGE_S,
            )
        )
    return tuple(lines)


def make_detail_rows(device: DeviceView, frame_age_s: float) -> RowsView:
    """Return the details of the picked device."""
    symbol, word, level = describe_state(device)
    # The reasons of rejection tell a wrong cable from a wrong protocol.
    kinds = ", ".join(
        f"{_(REJECTION_NAMES.get(kind, kind))} {count}" for kind, count in device.rejected_kinds
    )
    connects = _("times opened {count}").format(count=device.connects)
    rows = [
        DeviceRow(
            _("state"), f"{symbol} {word}", "stale" if frame_age_s > MAX_FRESH_AGE_S else level
        ),
        DeviceRow(_("port"), device.port or "--"),
        DeviceRow(_("protocol"), device.protocol or "--"),
        DeviceRow(
            _("bytes"), f"{_('in')} {device.bytes_in}   {_('out')} {device.bytes_out}   {connects}"
        ),
        DeviceRow(_("rejected"), kinds or "0"),
    ]
    if device.last_error:
        rows.append(
            DeviceRow(_("last error"), device.last_error, "" if device.connected else "amber")
        )
    if device.test is not None:
        rows.append(DeviceRow(_("test"), _describe_test(device)))
    rows.append(
        DeviceRow(
            _("raw file"), device.capture_path or _("not written; E starts one next to the log")
        )
    )
    return RowsView(device.name, tuple(rows))


def make_effort_row(says: EffortFinding, frame_age_s: float) -> RowsView:
    """Return the effort of the metering drive and the limits of its alarm; empty where no file has
    limits."""
    # A machine file without a reference of effort has no unit.
    if not says.unit:
        return RowsView("", ())
    text, level = _("stands: not judged"), "stale"
    if says.mean is not None:
        # A quarter more than the alarm limit keeps the mark of the limit inside the bar.
        full = 1.25 * max(says.high, says.mean)
        cells = [
            min(EFFORT_BAR_CELLS - 1, round(one / full * EFFORT_BAR_CELLS))
            for one in (says.mean, says.should, says.low, says.high)
        ]
        # The bar is the present effort; the marks are the expected value and the limits of the
        # alarm.
        marks = ["█"] * cells[0] + ["░"] * (EFFORT_BAR_CELLS - cells[0])
        for at, mark in zip(cells[1:], "│┃┃", strict=True):
            marks[at] = mark
        text = (
            "".join(marks)
            + " "
            + _("{mean} {unit}, expected {should}, alarm outside {low} to {high}").format(
                unit=says.unit,
                **{
                    name: f"{getattr(says, name):.3g}" for name in ("mean", "should", "low", "high")
                },
            )
        )
        level = (
            "stale"
            if frame_age_s > MAX_FRESH_AGE_S
            else "amber"
            if says.harder_percent or says.unloaded
            else ""
        )
    return RowsView("", (DeviceRow(_("effort"), text, level),))


def _describe_test(device: DeviceView) -> str:
    """Describe what a listening test has found."""
    test = device.test
    assert test is not None
    found = (
        _("{protocol} is heard").format(protocol=test.protocol)
        if test.protocol
        else _("listening, nothing known yet")
        if test.running
        else _("no known device is heard here")
    )
    counts = _("{accepted} understood, {rejected} rejected").format(
        accepted=test.accepted, rejected=test.rejected
    )
    baud = _("at {baud} Bd").format(baud=test.baud) if test.baud else ""
    return "; ".join(part for part in (found, baud, counts, test.said) if part)


def make_raw_rows(lines: Sequence[tuple[float, str]]) -> RowsView:
    """Return the last lines as received, newest last.

    Parameters
    ----------
    lines
        Log time (s) and text of each line.
    """
    return RowsView(
        _("last lines, as seen five times a second"),
        tuple(DeviceRow(format_duration(time_s), text) for time_s, text in lines),
    )
