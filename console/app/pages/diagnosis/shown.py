"""The Diagnosis page's views: a diagnosis in, what its panels show out. Pure."""
from __future__ import annotations

from console.app.pages.diagnosis import words
from console.app.pages.diagnosis.causes import CauseLine, CausesView
from console.app.pages.diagnosis.channel_table import ChannelLine, ChannelsView
from console.app.pages.diagnosis.data import CauseShown, ChannelShown, Curve, DiagnosisView, GainShown
from console.app.pages.diagnosis.residual_plot import PlotView
from console.app.pages.diagnosis.run_plan import PlanView
from console.app.pages.diagnosis.verdict import Said
from console.app.units import Units
from console.locale import _, in_use
from console.reports.words import as_items

MOST_GAIN_LINES = 3
LEAST_SHARE = 0.01              # of a channel's error beyond its noise: less is there, and is worth no mark


def said(found: DiagnosisView, lead: str) -> Said:
    return Said(found.verdict, words.VERDICT_SYMBOLS[found.verdict], _(words.VERDICTS[found.verdict]),
                words.about(found), words.sentence(found), words.todo(found), lead)


def causes(found: DiagnosisView, at: int, units: Units) -> CausesView:
    none = _("None. {count} effects cannot be seen in data of this kind at all.").format(count=found.unseen)
    calm = (*map(words.left, found.left), *_whole(found), none)
    return CausesView(tuple(_cause(cause, units) for cause in found.causes), at, calm, in_use())


def _cause(cause: CauseShown, units: Units) -> CauseLine:
    tied = words.ties(cause)
    title = _("one of these {count}, this data cannot tell which").format(count=len(tied)) if tied else (
        words.suspicion(cause))
    return CauseLine(title, words.size(cause), words.percent(cause.probability),
                     "" if tied else words.rivals(cause), words.cost(cause, units),
                     _("Drive the next test before anything is changed.") if tied else _(cause.advice),
                     interval(cause), tied)


def interval(cause: CauseShown) -> tuple[float, float, float] | None:
    """Low, size, high as shares of a bar that has zero in its middle."""
    if cause.value is None or cause.low is None or cause.high is None:
        return None
    most = max(abs(cause.value), abs(cause.low), abs(cause.high))
    if most <= 0.0:
        return None
    return round(cause.low / most, 2), round(cause.value / most, 2), round(cause.high / most, 2)


def channels(found: DiagnosisView) -> ChannelsView:
    gains = [_("on data not used for naming: {channel} {before} to {after} ({metric})").format(
        channel=words.channel_word(gain.channel), before=words.number(gain.before), after=words.number(gain.after),
        metric=gain.metric) for gain in _own(found.gains)[:MOST_GAIN_LINES]]
    return ChannelsView(tuple(_channel(one) for one in found.channels), (*found.notes, *map(words.left, found.left)),
                        (*_whole(found), *gains), in_use())


def _whole(found: DiagnosisView) -> tuple[str, ...]:
    """The drive as a whole, where it was fitted so."""
    return () if found.whole is None else (f"{words.whole(found.whole)}. {words.whole_gain(found.whole)}",)


def _own(gains: tuple[GainShown, ...]) -> list[GainShown]:
    """Those of the causes themselves; what is compared with them stands in the report."""
    return [gain for gain in gains if gain.of == "names"]


def _channel(one: ChannelShown) -> ChannelLine:
    after = "" if one.after is None else words.number(one.after)
    share = words.beyond_noise(one.error, one.noise) if one.structure else 0.0
    wrong = share >= LEAST_SHARE
    return ChannelLine(words.channel_word(one.channel), one.unit, words.number(one.error), after,
                       words.number(one.noise), words.percent(share) if wrong else "-", wrong)


def plan(found: DiagnosisView) -> PlanView:
    if found.next_run is None:
        return PlanView("", (), "", in_use())
    names = [words.title(cause) for cause in found.causes if cause.rivals]
    why = _("Tells apart: {names}.").format(names=", ".join(names)) if names else ""
    how = _("About {minutes} minutes. Drive it and diagnose its log; or try it on the simulated machine first.").format(
        minutes=f"{found.next_run.minutes:g}") if found.next_run.id else _("Do it by these steps; it cannot be "
                                                                           "simulated.")
    return PlanView(why, as_items(words.to_do(found)), how, in_use())


def over(found: DiagnosisView, at: int) -> PlotView | None:
    """Along the variable that tells the chosen cause; of what no cause explains where there is none."""
    curve = found.causes[at].over if found.causes else found.left_curve
    return _plot(curve, not found.causes)


def time(found: DiagnosisView, at: int) -> PlotView | None:
    return _plot(found.causes[at].time, False) if found.causes else None


def _plot(curve: Curve | None, same: bool) -> PlotView | None:
    if curve is None:
        return None
    return PlotView(words.curve_title(curve), words.variable_word(curve.label), curve.at, curve.before, curve.after,
                    curve.names, curve.onset, same, in_use())
