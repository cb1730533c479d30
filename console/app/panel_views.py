"""Converts a frame and its age to the texts and shares that panels show, as frozen values. Pure, in
one language.

A panel is drawn again only when its view differs from the last view, so every number here is
already rounded to the displayed digits.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from math import ceil
from typing import NamedTuple

from topdress.console.app import frame_words
from topdress.console.app.units import Units, choose_unit
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.log_row import HEAD_COLUMNS, NDRE_COLUMNS, LogRow
from topdress.control.orders import Alarm, Severity, TargetSource
from topdress.control.safety import ALARMS
from topdress.control.safety.limits import SafetyLimits
from topdress.control.signals import SIGNALS

# Older values, s, are displayed in grey.
MAX_FRESH_AGE_S = 1.0
# Rate errors are relative to the target, but at least to this rate: near zero any error would be
# huge.
MIN_ERROR_REFERENCE_KG_HA = 50.0
# Rate errors beyond these shares are amber or red on the screen.
AMBER_RATE_ERROR_SHARE = 0.10
RED_RATE_ERROR_SHARE = 0.20
LAG_NOTE_ID = "lag_out_of_range"
# Prefixes of notes about the ground ahead and the required flow. They are shown while working only,
# because otherwise no flow is required.
WORK_NOTE_PREFIXES = ("already_spread", "on_headland", "zero_", "limited_")
# Share at the ends of the error bar.
ERROR_BAR_END_SHARE = 0.30
# A shaft below this speed, r/min, counts as standing; the same limit as in safety.
MAX_STANDING_RPM = SafetyLimits().shaft_stands_rpm


# Numbers that the Run page shows next to its tiles where the machine has them.
RUN_SIGNALS = {name: one for name, one in SIGNALS.items() if one.is_on_run}

# From this time left, h, minutes tell an operator nothing.
LONG_TIME_LEFT_H = 10


class AgedText(NamedTuple):
    """Holds a text, and whether its value is stale."""

    text: str
    stale: bool = False


class StatusView(NamedTuple):
    """Holds the status line."""

    # Id of the state.
    state: str
    symbol: str
    word: str
    strategy: str
    source: str
    # Word before everything else, such as REPLAY.
    lead: str
    # Words such as SIMULATED or LOCKED.
    marks: tuple[str, ...]
    # Text such as "NO DATA 3 s", or "".
    silent: str
    clock: str
    elapsed: str


class AlarmLine(NamedTuple):
    """Holds one alarm in words."""

    id: str
    severity: Severity
    acknowledged: bool
    symbol: str
    word: str
    text: str
    place: str
    todo: str
    # Time of day of its beginning, where known.
    since: str
    lasted: str
    # Since when its cause has ended, in words; "" while the cause exists.
    gone: str = ""


class AlarmsView(NamedTuple):
    """Holds the alarms, or the text that replaces them."""

    lines: tuple[AlarmLine, ...]
    # Text without alarms.
    calm: str
    # Id of the alarm that caused the state FAULT; "" without a fault.
    fault: str = ""
    # True if `calm` demands an action, or if nothing is known.
    urgent: bool = False
    # Names of machine, crop, job and log, shown after `calm`.
    about: tuple[str, ...] = ()


class RatesView(NamedTuple):
    """Holds target and applied rate."""

    target: AgedText
    applied: AgedText
    unit: str
    nudge: str
    error: AgedText
    # Error as a share of the bar, -1 to 1.
    error_share: float | None
    # "", amber or red.
    level: str
    # Reasons why the rate differs from the wanted rate, most important first.
    notes: tuple[str, ...] = ()


class TileView(NamedTuple):
    """Holds one tile."""

    label: str
    unit: str
    value: AgedText
    below: str
    level: str = ""
    # Shorter form of `below` for a narrow tile.
    below_short: str = ""


class HeadView(NamedTuple):
    """Holds one canopy head."""

    number: int
    value: str
    share: float | None
    dropped: bool


class HeadsView(NamedTuple):
    """Holds the canopy heads."""

    fused: AgedText
    heads: tuple[HeadView, ...]
    valid: str


class ItemView(NamedTuple):
    """Holds a label and its value."""

    label: str
    value: AgedText


class RunView(NamedTuple):
    """Holds all panels of the Run page."""

    status: StatusView
    alarms: AlarmsView
    rates: RatesView
    tiles: tuple[TileView, ...]
    heads: HeadsView
    items: tuple[ItemView, ...]


def find_rate_error(target_kg_ha: float | None, applied_kg_ha: float | None) -> float | None:
    """Return the relative rate error (applied - target) / max(target, 50 kg/ha); None if a rate is
    unknown. The alarm "rate off" has the same formula, but not the present target."""
    if target_kg_ha is None or applied_kg_ha is None:
        return None
    return (applied_kg_ha - target_kg_ha) / max(target_kg_ha, MIN_ERROR_REFERENCE_KG_HA)


def find_applied_kg_ha(row: LogRow) -> float | None:
    """Return the rate that leaves the outlets, kg/ha.

    The rate is 0 where the machine does not work and the shaft speed is within the noise of a
    standing shaft. A shaft without a reading may turn.
    """
    stands = row.shaft_rpm is not None and abs(row.shaft_rpm) < MAX_STANDING_RPM
    if row.applied_rate_kg_ha is not None and stands and row.state not in (None, "working"):
        return 0.0
    return row.applied_rate_kg_ha


def format_signed_percent(percent: float) -> str:
    """Return a percentage in the form -3 %, 0 %, +12 %."""
    whole = round(percent)
    return f"{whole:+d} %" if whole else "0 %"


def format_duration(seconds: float) -> str:
    """Return a duration (s) in the form 1:02:03 or 02:03."""
    whole = int(max(0.0, seconds))
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes:02d}:{rest:02d}"


def format_time_left(seconds: float | None, is_short: bool = False) -> str:
    """Return a remaining time (s) in hours and minutes, such as "8 h 01 min", from ten hours on in
    hours; "--" for None. is_short : without the word for minutes after hours."""
    if seconds is None:
        return "--"
    # Rounded up: the last minute is not 0 min.
    hours, minutes = divmod(ceil(max(0.0, seconds) / 60.0), 60)
    if hours >= LONG_TIME_LEFT_H:
        return _("{hours} h").format(hours=hours + (minutes > 0))
    if not hours:
        return _("{minutes} min").format(minutes=minutes)
    text = _("{hours} h {minutes:02d}") if is_short else _("{hours} h {minutes:02d} min")
    return text.format(hours=hours, minutes=minutes)


def format_local_time(utc: str | None, offset_s: float, back_s: float = 0.0) -> str:
    """Return the local time of day of an ISO 8601 time minus `back_s`; "" where unknown."""
    if not utc:
        return ""
    try:
        moment = datetime.fromisoformat(utc.replace("Z", "+00:00")) + timedelta(
            seconds=offset_s - back_s
        )
    except (ValueError, OverflowError):
        return ""
    return moment.strftime("%H:%M:%S")


def make_run_view(
    frame: Frame | None,
    age_s: float,
    units: Units,
    utc_offset_s: float = 0.0,
    marks: tuple[str, ...] = (),
) -> RunView:
    """Return everything that the panels of the Run screen show.

    Parameters
    ----------
    frame
        Newest frame, or None before the first frame.
    age_s
        Time since the frame arrived, s.
    units
        Units of displayed values.
    utc_offset_s
        Local time minus UTC, s.
    marks
        Words that the screen adds to the status line.
    """
    if frame is None:
        return _make_empty_view(units, marks)
    old = age_s > MAX_FRESH_AGE_S
    return RunView(
        _make_status_view(frame, age_s, utc_offset_s, marks),
        make_alarms_view(frame, utc_offset_s, units, old),
        _make_rates_view(frame, old, units),
        _make_tiles(frame, old, units),
        _make_heads_view(frame, old),
        _make_items(frame, age_s, units),
    )


def _make_empty_view(units: Units, marks: tuple[str, ...]) -> RunView:
    """Return the view before the first frame."""
    blank = AgedText("--", True)
    status = StatusView(
        "", " ", _("NO DATA"), "", "", "", marks, _("waiting for the first values"), "", ""
    )
    tiles = tuple(TileView(label, unit, blank, "") for label, unit in _list_tile_labels(units))
    return RunView(
        status,
        AlarmsView((), _("no values yet")),
        RatesView(blank, blank, units.rate.name, "", blank, None, ""),
        tiles,
        HeadsView(blank, tuple(HeadView(n, "--", None, False) for n in range(1, 7)), ""),
        (),
    )


def _make_status_view(
    frame: Frame, age_s: float, utc_offset_s: float, marks: tuple[str, ...]
) -> StatusView:
    """Return the status line of a frame."""
    row = frame.row
    state = row.state or ""
    own = ((_("SIMULATED"),) if frame.simulated else ()) + tuple(
        _(word) for name, word in frame_words.ALLOWANCE_NAMES.items() if getattr(frame.allow, name)
    )
    silent = _("NO DATA {age}").format(age=f"{int(age_s)} s") if age_s > MAX_FRESH_AGE_S else ""
    word = frame_words.name_state(row.state, frame.why_state)
    # A state that may be outdated must not look like the present state.
    word = _("was {state}").format(state=word) if silent else word
    return StatusView(
        state,
        frame_words.STATE_SYMBOLS.get(state, " "),
        word,
        frame_words.name_strategy(row.strategy),
        frame_words.name_source(row.target_source, is_off_map(frame)),
        "",
        own + marks,
        silent,
        format_local_time(row.utc, utc_offset_s),
        format_duration(row.time_s),
    )


def is_off_map(frame: Frame) -> bool:
    """Tell whether the map has no rate at the machine's position."""
    row = frame.row
    return (
        frame.ordered_source == TargetSource.MAP
        and row.target_source == TargetSource.FALLBACK
        and row.lat_deg is not None
    )


def make_alarms_view(
    frame: Frame, utc_offset_s: float, units: Units, old: bool = False
) -> AlarmsView:
    """Return the alarms: red before amber, unacknowledged before acknowledged, else in the order of
    safety (worst first).

    A stale frame without alarms proves nothing, so `old` changes the text.
    """
    ordered = sorted(frame.alarms, key=lambda a: (a.severity is not Severity.RED, a.acknowledged))
    lines = []
    for alarm in ordered:
        said = frame_words.describe_alarm(alarm, units)
        lasted_s = max(0.0, frame.at_s - alarm.since_s)
        since = format_local_time(frame.row.utc, utc_offset_s, lasted_s)
        lines.append(
            AlarmLine(
                alarm.id,
                alarm.severity,
                alarm.acknowledged,
                frame_words.SEVERITY_SYMBOLS[alarm.severity],
                _(frame_words.SEVERITY_NAMES[alarm.severity]),
                said.text,
                said.place,
                said.todo,
                since,
                format_duration(lasted_s),
                _format_cause_gone(alarm, frame, utc_offset_s),
            )
        )
    fault = frame.why_state or "fault" if frame.row.state == "fault" else ""
    calm = _("no values: alarms are not known") if old else _("no alarms")
    # The alarm of the fault has ended: the text names the next step, then the former alarm.
    if fault and not old:
        was = (
            frame_words.describe_alarm(Alarm(fault, Severity.RED, 0.0)).text
            if fault in ALARMS
            else ""
        )
        calm = (
            f"{_('FAULT, its cause is gone: R on the Run page makes the machine ready.')}   "
            f"{was}".rstrip()
        )
    return AlarmsView(tuple(lines), calm, fault, old or bool(fault))


def mask_lost_machine(view: RunView, key: str) -> RunView:
    """Replace the alarms of a view whose control worker is lost. The machine may still spread,
    stand or alarm; the last alarms stay in the list of alarms. `key` connects."""
    calm = _(
        "No connection to the machine: its state and alarms are not known. STOP is the "
        "hard-wired one; {key} connects."
    )
    return view._replace(alarms=AlarmsView((), calm.format(key=key), urgent=True))


def mask_missing_machine(view: RunView, key: str) -> RunView:
    """Replace the alarms of a view without any machine, because waiting brings no values. `key`
    connects."""
    status = view.status._replace(silent=_("no machine is connected"))
    calm = _("{key} connects a machine.").format(key=key)
    return view._replace(status=status, alarms=AlarmsView((), calm, urgent=True))


def _format_cause_gone(alarm: Alarm, frame: Frame, utc_offset_s: float) -> str:
    """Return since when the cause of an alarm has ended; "" while it exists."""
    if alarm.gone_s is None:
        return ""
    ago_s = max(0.0, frame.at_s - alarm.gone_s)
    since = format_local_time(frame.row.utc, utc_offset_s, ago_s)
    if since:
        return _("cause gone at {time}").format(time=since)
    return _("cause gone for {duration}").format(duration=format_duration(ago_s))


def _make_rates_view(frame: Frame, old: bool, units: Units) -> RatesView:
    """Return target, applied rate and error of a frame."""
    row = frame.row
    # A foreign log has no state (None). On hold or off no flow is required, so there is no error.
    at_work = row.state in (None, "working")
    error = find_rate_error(row.target_rate_kg_ha, row.applied_rate_kg_ha) if at_work else None
    level = ""
    if error is not None and abs(error) > AMBER_RATE_ERROR_SHARE:
        level = "red" if abs(error) > RED_RATE_ERROR_SHARE else "amber"
    nudge = "" if not row.nudge_percent else f"{row.nudge_percent:+.0f} %"
    return RatesView(
        AgedText(units.rate.format_value(row.target_rate_kg_ha), old),
        AgedText(units.rate.format_value(find_applied_kg_ha(row)), old),
        units.rate.name,
        nudge,
        AgedText("--" if error is None else format_signed_percent(100 * error), old),
        None if error is None else round(max(-1.0, min(1.0, error / ERROR_BAR_END_SHARE)), 2),
        level,
        explain_rate(frame),
    )


def explain_rate(frame: Frame) -> tuple[str, ...]:
    """Return the reasons why nothing flows while working, else why the rate differs from the wanted
    rate; () without a reason."""
    row, at_work = frame.row, frame.row.state in (None, "working")
    notes = [
        note
        for note in frame.notes
        if note != LAG_NOTE_ID and (at_work or not note.startswith(WORK_NOTE_PREFIXES))
    ]
    if at_work and frame.why_no_flow:
        notes = list(frame.why_no_flow)
    elif row.state == "working" and row.target_rate_kg_ha == 0.0 and not notes:
        notes = ["rate_is_zero"]
    return tuple(frame_words.name_note(note) for note in notes)


def _list_tile_labels(units: Units) -> tuple[tuple[str, str], ...]:
    """Return label and unit of each tile."""
    return (
        (_("speed"), units.speed.name),
        (_("shaft"), units.shaft.name),
        (_("opening"), units.opening.name),
        (_("hopper"), units.mass.name),
    )


def _make_tiles(frame: Frame, old: bool, units: Units) -> tuple[TileView, ...]:
    """Return the tiles of a frame."""
    row = frame.row
    board_old = old or _is_device_stale(frame, "board")
    # The controller's own speed comes first, because it determines the rate.
    speed_mps = row.speed_used_mps if row.speed_used_mps is not None else row.speed_mps
    usable = frame.usable_speed_mps
    fast = usable is not None and speed_mps is not None and speed_mps > usable
    low = any(alarm.id.startswith("hopper") for alarm in frame.alarms)
    speed_below = (
        _("max {speed}").format(speed=units.speed.format_value(usable))
        if usable is not None
        else ""
    )
    left = frame.metres_left_m
    hopper_below = (
        _("{distance} left").format(distance=units.choose_way_unit(left).format_with_name(left))
        if left is not None
        else ""
    )
    below = (
        speed_below,
        _format_set_value(units.shaft.format_value(row.shaft_rpm_cmd)),
        _format_set_value(units.opening.format_value(row.opening_mm_cmd)),
        hopper_below,
    )
    values = (
        AgedText(units.speed.format_value(speed_mps), old),
        AgedText(units.shaft.format_value(row.shaft_rpm), board_old),
        AgedText(units.opening.format_value(row.opening_mm), board_old),
        AgedText(units.mass.format_value(row.hopper_kg), board_old),
    )
    levels = ("amber" if fast else "", "", "", "amber" if low else "")
    short = (
        units.speed.format_value(usable),
        units.shaft.format_value(row.shaft_rpm_cmd),
        units.opening.format_value(row.opening_mm_cmd),
        units.choose_way_unit(left).format_with_name(left) if left is not None else "",
    )
    return tuple(
        TileView(label, unit, value, under, level, fewer)
        for (label, unit), value, under, level, fewer in zip(
            _list_tile_labels(units), values, below, levels, short, strict=True
        )
    )


def _format_set_value(value: str) -> str:
    """Return the text of a set-point."""
    return _("set {value}").format(value=value)


def _make_heads_view(frame: Frame, old: bool) -> HeadsView:
    """Return the canopy heads of a frame, by NDRE if any head reports it."""
    row = frame.row
    old = old or _is_device_stale(frame, "heads")
    by_red_edge = any(getattr(row, name) is not None for name in (*NDRE_COLUMNS, "ndre"))
    readings = [getattr(row, name) for name in (NDRE_COLUMNS if by_red_edge else HEAD_COLUMNS)]
    fused = row.ndre if by_red_edge else row.ndvi
    heads = tuple(
        HeadView(
            n,
            "--" if value is None else f"{value:.2f}",
            None if value is None else round(max(0.0, min(1.0, value)), 2),
            n in frame.dropped_heads,
        )
        for n, value in enumerate(readings, 1)
    )
    # Heads that the fusion dropped do not count as good.
    good = sum(head.share is not None and not head.dropped for head in heads)
    return HeadsView(
        AgedText("--" if fused is None else f"{fused:.2f}", old),
        heads,
        _("{good} of {all} heads").format(good=good, all=len(heads)),
    )


def _make_items(frame: Frame, age_s: float, units: Units) -> tuple[ItemView, ...]:
    """Return the items next to the tiles: GNSS, look-ahead, trim, area, mass."""
    row = frame.row
    old = age_s > MAX_FRESH_AGE_S
    # In a stale frame the age would stand still, so the frame's own age is added.
    gnss_age_s = None if frame.gnss_age_s is None else frame.gnss_age_s + (age_s if old else 0.0)
    gnss_old = old or gnss_age_s is None or gnss_age_s > MAX_FRESH_AGE_S
    fix = frame_words.name_fix(row.fix_quality)
    satellites = "--" if row.satellites is None else str(row.satellites)
    hz = "--" if frame.gnss_hz is None else f"{frame.gnss_hz:.0f}"
    age = "--" if gnss_age_s is None else f"{gnss_age_s:.1f}"
    unsure = f"  ! {_('range')}" if LAG_NOTE_ID in frame.notes else ""
    lag = (
        f"{units.time.format_with_name(row.lag_s)}  "
        f"{units.fine_distance.format_with_name(row.lag_m)}{unsure}"
    )
    trim = "--" if row.flow_trim is None else f"{row.flow_trim:.3f}"
    by_plant = list_point_items(frame, old, units)
    return (
        ItemView(
            _("GNSS"), AgedText(f"{fix}  {_('{count} sat').format(count=satellites)}", gnss_old)
        ),
        ItemView(_("fix age"), AgedText(f"{age} s  {hz} Hz", gnss_old)),
        ItemView(_("look-ahead"), AgedText(lag if frame.look_ahead else f"{lag}  {_('OFF')}", old)),
        *(
            by_plant
            or (
                ItemView(
                    _("scale trim"),
                    AgedText(trim if frame.flow_trim_on else f"{trim}  {_('OFF')}", old),
                ),
                ItemView(_("done"), AgedText(units.area.format_with_name(frame.area_ha), old)),
            )
        ),
        ItemView(
            _("applied"),
            AgedText(
                f"{units.mass.format_with_name(frame.applied_kg)}  "
                + _("mean {rate}").format(rate=units.rate.format_with_name(frame.mean_rate_kg_ha)),
                old,
            ),
        ),
        *(
            ItemView(
                _(signal.label), AgedText(choose_unit(signal, units).format_with_name(value), old)
            )
            for name, signal in RUN_SIGNALS.items()
            if (value := getattr(row, name)) is not None
        ),
    )


def list_point_items(frame: Frame, old: bool, units: Units) -> tuple[ItemView, ...]:
    """Return doses given and missed and the learned threshold (a larger threshold doses earlier);
    () outside point mode."""
    t = frame.totals
    if frame.threshold_m is None or t is None or t.doses is None:
        return ()
    metres = units.fine_distance._replace(decimals=2)
    return (
        ItemView(
            _("doses"),
            AgedText(
                _("{count}  missed {missed}").format(count=t.doses, missed=t.doses_missed or 0), old
            ),
        ),
        ItemView(
            _("threshold"),
            AgedText(
                f"{frame.threshold_m * metres.per_si:+.{metres.decimals}f} {metres.name}", old
            ),
        ),
    )


def _is_device_stale(frame: Frame, name: str) -> bool:
    """Return whether a device of the frame is silent."""
    return any(
        device.name == name and (device.age_s is None or device.age_s > MAX_FRESH_AGE_S)
        for device in frame.devices
    )
