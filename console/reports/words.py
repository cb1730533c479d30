"""What terminal, report and Diagnosis page say alike: since when, how much is left, what is only suspected."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from console.locale import N_, _
from console.reports.numbers import MINUS, decimals_of, fixed, number
from control.diagnosis.result import RUN_CHANNELS, UNKNOWN, Data, Unexplained

SOMETHING_ELSE = N_("something else")       # title of the rival UNKNOWN
HEADLINE = 0.5                              # least probability of a cause that a headline names


class _Rival(Protocol):
    @property
    def id(self) -> str: ...
    @property
    def probability(self) -> float: ...


class _Cause(Protocol):
    """`result.Cause`, and as the page has it."""

    @property
    def id(self) -> str: ...
    @property
    def probability(self) -> float: ...
    @property
    def rivals(self) -> Sequence[_Rival]: ...


def name_of(effect_id: str) -> str:
    """The id where it is an effect's; of what is none, its title."""
    return _(SOMETHING_ELSE) if effect_id == UNKNOWN else effect_id


def as_items(steps: Sequence[str]) -> tuple[str, ...]:
    """What is to be done, as the items of a list: each with a capital, and without the stop of a sentence."""
    return tuple(step[0].upper() + step[1:].rstrip(".") for step in steps if step)


def headlined(cause: _Cause) -> bool:
    """Whether a cause is likely enough for a headline: else it is only suspected."""
    return cause.probability >= HEADLINE and all(
        rival.probability < cause.probability for rival in cause.rivals if rival.id != cause.id)


def tied(cause: _Cause) -> bool:
    """Whether a cause has rivals with a name, that the data cannot tell it from: then all of them are equals."""
    return any(rival.id not in (UNKNOWN, cause.id) for rival in cause.rivals)


def undecided(cause: _Cause) -> bool:
    """Whether no machine file takes a cause up unless somebody picks it by its name."""
    return tied(cause) or not headlined(cause)


def without_names(verdict: str, channels: bool, causes: int, likely: int) -> str | None:
    """The sentence of a verdict that names no cause; None where it names some, or what is left. channels: some were
    judged. causes, likely: how many there are, and how many of them a headline may name."""
    if verdict == "none":
        return _("Everything is as the machine file says, as far as the sensors can tell.")
    if verdict == "not_judged":
        return _("This data is too short, or moves too little, to say that nothing is wrong.") if channels \
            else _("None of this data could be compared with the machine file.")
    if likely or verdict == "unexplained":
        return None
    if not causes:
        return _("Nothing with a name was found.")
    return _("Something is there, but no cause is likely enough to be named; suspected: {count}.").format(count=causes)


def when(onset_s: float | None, until_s: float | None, grows: bool, value: float | None, unit: str) -> str:
    """Which part of the log an effect of size `value` is in, s; "" where it was there all along."""
    begin, end = f"{onset_s or 0.0:.0f}", f"{until_s or 0.0:.0f}"
    if grows:
        last = _("its size") if value is None else f"{_plain(value, 3)} {_(unit)}"
        return _("grows from {begin} s on to {size} at the end").format(begin=begin, size=last)
    if until_s is not None:
        return _("until {end} s").format(end=end) if onset_s is None else _("from {begin} s to {end} s").format(
            begin=begin, end=end)
    return "" if onset_s is None else _("since {begin} s").format(begin=begin)


def left_facts(left: Unexplained) -> tuple[str, ...]:
    """How much of a channel no effect explains, when, and what comes nearest."""
    said = []
    if left.rms is not None and left.noise is not None:
        decimals = decimals_of(left.noise if left.noise > 0.0 else left.rms)
        said.append(_("{rms} {unit} r.m.s. where the sensors' noise is {noise} {unit}").format(
            rms=_fixed(left.rms, decimals), noise=_fixed(left.noise, decimals), unit=left.unit))
    if left.dose_percent is not None:
        said.append(_("{percent} % of the dose").format(percent=_plain(abs(left.dose_percent), 2)))
    if left.from_s is not None:
        said.append(_("seems to begin at {begin} s").format(begin=f"{left.from_s:.0f}"))
    if left.period_s is not None:
        said.append(_("comes and goes every {period} s").format(period=_plain(left.period_s, 2)))
    if left.hint:
        said.append(_("nearest: {effect}, whose evidence does not hold").format(effect=left.hint))
    return tuple(said)


def not_judged(data: Data, judged: Sequence[str]) -> tuple[str, ...]:
    """Channels that a run log of such a machine may have and that could not be judged in this one; of bench tables
    none."""
    may = data.stages or RUN_CHANNELS
    return tuple(channel for channel in RUN_CHANNELS if channel in may and channel not in judged) \
        if data.kind == "run" else ()


def _plain(value: float, digits: int) -> str:
    """Without the zeros behind that say nothing, and with a minus that every terminal has."""
    text = number(value, digits).replace(MINUS, "-")
    return text.rstrip("0").rstrip(".") if "." in text else text


def _fixed(value: float, decimals: int) -> str:
    return fixed(value, decimals).replace(MINUS, "-")
