"""How does one line show a departure from the model, in the language in use? The line has channel,
size, begin and probable cause.
"""

from __future__ import annotations

from topdress.console.locale import _
from topdress.console.reports.diagnosis_wording import find_effect_title, name_channel
from topdress.control.diagnosis.result import ModelDeviation

# Share of the dose, %, below which no number is given.
MIN_SHOWN_PERCENT = 0.5


def format_departure(found: ModelDeviation, since: str, why: bool = True) -> str:
    """Returns a departure in one line.

    `since` is a time of day or of the log; empty for an unknown time. The name of the cause is
    omitted without `why`.
    """
    said = describe_change(found)
    if since:
        said = _("{what} since {time}").format(what=said, time=since)
    if found.cause and why:
        title = find_effect_title(found.cause)
        form = _("{said}. Probably: {why}") if found.certain else _("{said}. Perhaps: {why}")
        said = form.format(said=said, why=title)
    return said


def describe_change(found: ModelDeviation) -> str:
    """Returns the departing channel, and the departure as a share of the dose."""
    channel = name_channel(found.channel)
    if found.percent is None or abs(found.percent) < MIN_SHOWN_PERCENT:
        return _("{channel} is not as it should be").format(channel=channel)
    share = (
        f"{abs(found.percent):.0f}" if abs(found.percent) >= 2.0 else f"{abs(found.percent):.1f}"
    )
    form = (
        _("{share} % too little spread, by the {channel}")
        if found.percent < 0.0
        else _("{share} % too much spread, by the {channel}")
    )
    if found.channel == "flow":
        form = (
            _("{share} % too little flows")
            if found.percent < 0.0
            else _("{share} % too much flows")
        )
    return form.format(channel=channel, share=share)


def describe_next_step(found: ModelDeviation, console: bool = True) -> str:
    """Returns the offer after the machine is held. `console` means that a page can do it; otherwise
    a command does."""
    if found.next_run and not found.adoptable:
        return _("{offer}: {plan}").format(
            offer=describe_offer(found, console), plan=_(found.next_run)
        )
    return describe_offer(found, console)


def describe_offer(found: ModelDeviation, console: bool = True) -> str:
    """Returns the offer without the run that separates rivals."""
    if not console:
        if found.adoptable:
            return _("adopt it into the machine file: topdress diagnose --adopt")
        return (
            _("the run that tells which")
            if found.next_run
            else _("what it is and what to do: topdress diagnose")
        )
    if found.adoptable:
        return _("F9: adopt it into the machine file")
    return (
        _("F9: the run that tells which") if found.next_run else _("F9: what it is and what to do")
    )
