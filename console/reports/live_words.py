"""A departure from the model in one line, in the language in use: what, by how much, since
when, probably why."""

from __future__ import annotations

from topdress.console.locale import _
from topdress.console.reports.diagnosis_wording import name_channel, title_of
from topdress.control.diagnosis.result import Departure

LEAST_PERCENT = 0.5  # of the dose: less is not given as a number


def departure_line(found: Departure, since: str, why: bool = True) -> str:
    """`since`: time of day or of the log; empty: not known, or left out as the name is without
    `why`."""
    said = what(found)
    if since:
        said = _("{what} since {time}").format(what=said, time=since)
    if found.cause and why:
        title = title_of(found.cause)
        form = _("{said}. Probably: {why}") if found.certain else _("{said}. Perhaps: {why}")
        said = form.format(said=said, why=title)
    return said


def what(found: Departure) -> str:
    """Which channel departs, and by how much of the dose."""
    channel = name_channel(found.channel)
    if found.percent is None or abs(found.percent) < LEAST_PERCENT:
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


def todo(found: Departure, console: bool = True) -> str:
    """What is offered once the machine is held. console: there is a page for it; else a command
    does it."""
    if found.next_run and not found.adoptable:
        return _("{offer}: {plan}").format(offer=offer(found, console), plan=_(found.next_run))
    return offer(found, console)


def offer(found: Departure, console: bool = True) -> str:
    """The same without what the run is that tells rivals apart."""
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
