"""Translates the ids in frames to words: states, strategies, sources, fixes, alarms, answers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from topdress.console.app.units import METRIC, Unit, Units
from topdress.console.locale import N_, _
from topdress.control.orders import Alarm, Severity, Strategy
from topdress.control.safety import ALARMS, REFUSALS, read_refusal

# Names are translated on use, because the language may change while the console runs.
STATE_NAMES = {
    "off": N_("OFF"),
    "ready": N_("READY"),
    "working": N_("WORKING"),
    "held": N_("HELD"),
    "calibrating": N_("CALIBRATING"),
    "fault": N_("FAULT"),
}
# Each state has a sign besides its colour, for terminals with few colours.
STATE_SYMBOLS = {
    "off": "▯",
    "ready": "▹",
    "working": "▸",
    "held": "▮▮",
    "calibrating": "✚",
    "fault": "✖",
}

# The words are those of the ids, such as `opening first`.
STRATEGY_NAMES = {one.value: one.value.replace("_", " ") for one in Strategy}
# The fallback rate is in capitals, because it means that the wanted source is missing.
SOURCE_NAMES = {
    "canopy": N_("from canopy"),
    "map": N_("from map"),
    "point": N_("plant by plant"),
    "manual": N_("manual rate"),
    "fallback": N_("FALLBACK RATE"),
    "none": N_("no target"),
    "map_and_canopy": N_("map and canopy"),
    "index_map": N_("index map"),
    "external": N_("other display"),
}
# Keys are the fix qualities of NMEA's GGA sentence.
FIX_NAMES = {
    0: N_("no fix"),
    1: N_("GNSS"),
    2: N_("DGNSS"),
    4: N_("RTK fixed"),
    5: N_("RTK float"),
    6: N_("dead reckoning"),
}

SEVERITY_NAMES = {Severity.RED: N_("ALARM"), Severity.AMBER: N_("CAUTION")}
SEVERITY_SYMBOLS = {Severity.RED: "✖", Severity.AMBER: "!"}

# Notes of the control loop and interlocks of safety.
NOTE_NAMES = {
    "limited_lowest": N_("machine's lowest"),
    "limited_highest": N_("machine's highest"),
    "limited_zero": N_("closed: below the machine's lowest rate"),
    "not_working": N_("not working"),
    "drive_silent": N_("a drive is silent"),
    "speed_silent": N_("no speed"),
    "standstill": N_("standing still"),
    "low_speed": N_("too slow"),
    "wheel_speed_missing": N_("wheel sensor silent"),
    "gnss_speed_missing": N_("GNSS tells no speed"),
    "reversing": N_("reversing"),
    "course_unknown": N_("course not known yet"),
    "position_lost": N_("no position"),
    "outside_field": N_("lands outside field"),
    "map_elsewhere": N_("the map lies elsewhere"),
    "work_switch_up": N_("work switch is up"),
    "log_failed": N_("log not writable"),
    "target_refused": N_("target refused"),
    "below_range": N_("below the machine's range"),
    "already_spread": N_("already spread"),
    "on_headland": N_("headland"),
    "growth_stage_outside": N_("growth stage"),
    "rate_is_zero": N_("rate here is zero"),
    "zero_above_cutoff": N_("canopy too dense: no rate"),
    "zero_below_cutoff": N_("bare soil: no rate"),
    "zero_yield_reached": N_("canopy needs nothing"),
    "zero_map": N_("the map says 0 here"),
    "zero_unmapped": N_("no rate in the map here"),
    "zero_no_zone": N_("the zone gets nothing"),
    "zero_external": N_("the other display says 0"),
    "zero_silent": N_("the other display is silent: 0"),
    "zero_manual": N_("the manual rate is 0"),
    "zero_fallback": N_("the fallback rate is 0"),
}
# Capitals, because an allowance weakens an interlock and must stay visible.
ALLOWANCE_NAMES = {
    "reverse": N_("REVERSE OK"),
    "outside": N_("OUTSIDE OK"),
    "unlogged": N_("NO LOG OK"),
    "map_elsewhere": N_("MAP ELSEWHERE OK"),
    "no_wheel": N_("NO WHEEL OK"),
}

# `REFUSALS` has the texts of safety's refusals; these are the refusals of other rooms.
ANSWER_TEXTS: Mapping[str, str] = dict(REFUSALS) | {
    "no_lag_rig": N_("No signal from the lag rig."),
    "no_such_device": N_("There is no device {device}."),
    "device_in_use": N_("Not possible in state {state}."),
    "device_disconnected": N_("The device {device} is disconnected."),
    "no_log": N_("There is no log to put the file next to."),
    "no_machine": N_("no machine is connected"),
    "no_answer": N_("The machine has not answered yet: watch its state, at the top left."),
    "replay": N_("This is a replay: the log cannot be changed."),
    "unauthorised": N_("This console only looks: orders are not taken."),
    "busy": N_("The machine is busy; try again."),
    "unknown_strategy": N_("This strategy is not known."),
    "source_not_ready": N_("This source of the target is not ready."),
    "nudge_out_of_range": N_("The nudge is out of its range."),
    "rate_out_of_range": N_("The rate is out of its range."),
    "strip_out_of_range": N_("The NDVI of a strip is above 0 and at most 1."),
    "dose_error_out_of_range": N_("A dose error is at most 2 m."),
    "section_off_or_auto": N_("A section is closed by hand or given back."),
    "year_ceiling": N_("A ceiling of nitrogen holds: no place gets it twice."),
    "no_such_section": N_("The machine has no such section, or none with a valve."),
    "no_dose_landed": N_("No dose has landed yet, or the job has no plants."),
}


# Reasons why a section is closed.
SECTION_NAMES = {
    "outside": N_("outside"),
    "headland": N_("headland"),
    "done": N_("done"),
    "map": N_("map: nothing"),
    "hand": N_("BY HAND"),
    "no_flow": N_("closed"),
}


def name_state(state: str | None, why: str = "") -> str:
    """Return the word of a state."""
    return _(STATE_NAMES.get(state or "", state or "")) or (
        _("RECORDS ONLY") if why == "record_only" else _("NO STATE")
    )


def name_strategy(strategy: str | None) -> str:
    """Return the word of a strategy."""
    return _(STRATEGY_NAMES.get(strategy or "", strategy or ""))


def name_source(source: str | None, is_off_map: bool = False) -> str:
    """Return the word of a target source. is_off_map : the map has no rate at a known position,
    which is no fault of a sensor."""
    if is_off_map:
        return _("no rate in the map here")
    return _(SOURCE_NAMES.get(source or "", source or ""))


def name_fix(fix_quality: int | None) -> str:
    """Return the word of a fix quality."""
    return _("no GNSS") if fix_quality is None else _(FIX_NAMES.get(fix_quality, N_("no fix")))


class AlarmWords(NamedTuple):
    """Holds one alarm in the language in use."""

    text: str
    todo: str
    place: str


def describe_alarm(alarm: Alarm, units: Units = METRIC) -> AlarmWords:
    """Return text, remedy and place of an alarm with its details; only the id for an unknown alarm
    of another version."""
    kind = ALARMS.get(alarm.id)
    if kind is None:
        return AlarmWords(alarm.id, "", "")
    # Details are pairs of name and value, as on the wire.
    details = dict(alarm.details)
    return AlarmWords(
        _fill_values(kind.text, details, units),
        _fill_values(kind.todo, details, units),
        _fill_values(kind.place, details, units),
    )


def describe_refusal(why: str, alarms: Iterable[Alarm] = ()) -> str:
    """Word a refusal.

    Parameters
    ----------
    why
        Id with details, as `control.safety.read_refusal` parses it.
    alarms
        Standing alarms, one of which the refusal may name.
    """
    if not why:
        return _("not accepted")
    # The id precedes the details.
    name, _mark, _rest = why.partition(";")
    if name not in ANSWER_TEXTS:
        return why
    try:
        details = read_refusal(why)[1]
    except ValueError:
        details = {}
    shown: dict[str, str | float] = dict(details)
    # A refusal may be caused by an alarm, whose text is inserted.
    if "alarm" in details:
        named = next(
            (one for one in alarms if one.id == details["alarm"]),
            Alarm(details["alarm"], Severity.RED, 0.0),
        )
        shown["alarm"] = describe_alarm(named).text.rstrip(".")
    if "state" in details:
        shown["state"] = name_state(details["state"])
    return _fill_values(ANSWER_TEXTS[name], shown)


def name_note(note: str) -> str:
    """Return the words of a note of the loop or of an interlock; the id for an unknown note."""
    return _(NOTE_NAMES.get(note, note))


def _fill_values(text: str, details: Mapping[str, str | float], units: Units = METRIC) -> str:
    """Return the translated text with its values; a missing value becomes `--`, never an error or a
    name in braces.

    Where the text has a value in SI ("{speed_mps} m/s"), number and unit are replaced by displayed
    ones.
    """
    said = _(text)
    for key, value in details.items():
        for ending, si_name, unit in _list_measures(units):
            if key.endswith(ending) and isinstance(value, int | float):
                said = said.replace(f"{{{key}}} {si_name}", unit.format_with_name(value))
    shown = {
        key: f"{value:g}" if isinstance(value, float) else value for key, value in details.items()
    }
    # A faulty text of a translation must not stop the alarm.
    try:
        return said.format_map(_KnownValues(shown))
    except (KeyError, IndexError, ValueError):
        return said


class _KnownValues(dict[str, "str | float"]):
    """Returns `--` for a missing value."""

    def __missing__(self, name: str) -> str:
        return "--"


def _list_measures(units: Units) -> tuple[tuple[str, str, Unit], ...]:
    """Return the ending of a detail's name, its internal unit, and its displayed unit."""
    # Masses in alarms need a decimal: a flow of 0.4 kg matters.
    kilograms = units.mass._replace(decimals=1)
    return (
        ("_mps", "m/s", units.speed),
        ("_kg_ha", "kg/ha", units.rate),
        ("_kg", "kg", kilograms),
        ("metres_left", "m", units.distance),
    )
