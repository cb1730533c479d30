"""Words for what frames carry as ids: states, strategies, sources, fixes, alarms, answers. Translated when asked."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from console.locale import N_, _
from control.orders import Alarm, Severity

try:
    from control.safety import ALARMS as _KINDS
except ImportError:                                   # the ids then stand for the texts
    _KINDS = {}
ALARM_KINDS: Mapping[str, Any] = _KINDS

STATES = {
    "off": N_("OFF"), "ready": N_("READY"), "working": N_("WORKING"), "held": N_("HELD"),
    "calibrating": N_("CALIBRATING"), "fault": N_("FAULT"),
}
STATE_SYMBOLS = {"off": "▯", "ready": "▹", "working": "▸", "held": "▮▮", "calibrating": "✚", "fault": "✖"}

STRATEGIES = {
    "opening_first": N_("opening first"), "speed_first": N_("speed first"), "balanced": N_("balanced"),
}
SOURCES = {
    "canopy": N_("from canopy"), "map": N_("from map"), "point": N_("plant by plant"), "manual": N_("manual rate"),
    "fallback": N_("FALLBACK RATE"), "none": N_("no target"),
}
FIXES = {0: N_("no fix"), 1: N_("GNSS"), 2: N_("DGNSS"), 4: N_("RTK fixed"), 5: N_("RTK float"),
         6: N_("dead reckoning")}

SEVERITIES = {Severity.RED: N_("ALARM"), Severity.AMBER: N_("CAUTION")}
SEVERITY_SYMBOLS = {Severity.RED: "✖", Severity.AMBER: "!"}

NOTES = {"lag_out_of_range": N_("lag model out of its range")}

ANSWERS = {
    "no_answer": N_("no answer from the control worker yet: watch the state"),
    "replay": N_("this is a replay: the log cannot be changed"),
    "unauthorised": N_("this console only looks: orders are not taken"),
}


def state_word(state: str | None) -> str:
    return _(STATES.get(state or "", state or "")) or _("NO STATE")


def strategy_word(strategy: str | None) -> str:
    return _(STRATEGIES.get(strategy or "", strategy or ""))


def source_word(source: str | None) -> str:
    return _(SOURCES.get(source or "", source or ""))


def fix_word(fix_quality: int | None) -> str:
    return _("no GNSS") if fix_quality is None else _(FIXES.get(fix_quality, N_("no fix")))


class AlarmWords(NamedTuple):
    """One alarm in the language in use."""

    text: str
    todo: str
    place: str


def alarm_words(alarm: Alarm) -> AlarmWords:
    """Text, what to do and place of an alarm, its details filled in; the id where the alarm is not known here."""
    kind = ALARM_KINDS.get(alarm.id)
    if kind is None:
        return AlarmWords(alarm.id, "", "")
    details = dict(alarm.details)
    return AlarmWords(_filled(kind.text, details), _filled(kind.todo, details), _filled(kind.place, details))


def answer_words(why: str) -> str:
    """A refusal in words. `why` is an id, or an id and its details: `id key=value key=value`."""
    name, *rest = why.split(" ")
    if name not in ANSWERS:
        return _(why) if why else _("not accepted")
    details: dict[str, str | float] = dict(part.split("=", 1) for part in rest if "=" in part)
    return _filled(ANSWERS[name], details)


def _filled(text: str, details: Mapping[str, str | float]) -> str:
    """The translated text with its values; a value that is missing leaves its braces, never an error on the screen."""
    shown = {key: f"{value:g}" if isinstance(value, float) else value for key, value in details.items()}
    try:
        return _(text).format(**shown)
    except (KeyError, IndexError, ValueError):
        return _(text)
