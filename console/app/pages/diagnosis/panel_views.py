"""Converts a diagnosis to the views of the page's panels. Pure."""

from __future__ import annotations

from topdress.console.app.pages.diagnosis import diagnosis_words
from topdress.console.app.pages.diagnosis.causes import CauseLine, CausesView
from topdress.console.app.pages.diagnosis.channel_table import ChannelLine, ChannelsView
from topdress.console.app.pages.diagnosis.residual_plot import PlotView
from topdress.console.app.pages.diagnosis.run_plan import PlanView
from topdress.console.app.pages.diagnosis.service import DiagnosisView, ResidualCurve
from topdress.console.app.pages.diagnosis.verdict import VerdictTexts
from topdress.console.app.units import Units
from topdress.console.locale import _, find_language_code
from topdress.console.reports import diagnosis_wording as sentences
from topdress.console.reports.number_text import format_percent
from topdress.console.reports.variable_names import find_variable
from topdress.control.diagnosis.result import Cause, Channel, Diagnosis, Size

# More lines would push the table of channels off the panel.
MAX_GAIN_LINES = 3
# Significance level below which a channel's residual counts as more than noise.
MAX_STRUCTURE_P = 0.01
# Smaller shares of the error beyond the noise exist but are too small to matter, so they are not
# marked.
MIN_MARKED_SHARE = 0.01


def make_verdict(view: DiagnosisView, lead: str) -> VerdictTexts:
    """Return the verdict for its panel."""
    _word, name, symbol = sentences.VERDICT_WORDS[view.found.verdict]
    return VerdictTexts(
        view.found.verdict,
        symbol,
        _(name),
        diagnosis_words.describe_data(view),
        sentences.format_verdict_line(view.found),
        diagnosis_words.describe_next_step(view),
        lead,
    )


def make_causes_view(view: DiagnosisView, at: int, units: Units) -> CausesView:
    """Return the causes for their list."""
    found = view.found
    # A verdict "none" must say what this kind of file can never show.
    unseen = sum(one.smallest_detectable.value is None for one in found.not_shown)
    none = _("None. {count} kinds of fault never show in a file of this kind.").format(count=unseen)
    return CausesView(
        tuple(_make_cause_line(cause, view.mean_target_kg_ha, units) for cause in found.causes),
        at,
        (*_list_unexplained(found), *_describe_whole_drive(found), none),
        find_language_code(),
    )


def _make_cause_line(cause: Cause, mean_target_kg_ha: float | None, units: Units) -> CauseLine:
    """Return one cause in words."""
    # Causes that the data cannot separate have equal rank, so there are no rivals.
    tied = sentences.list_ties(cause)
    rivals = (
        ""
        if tied
        else ", ".join(
            f"{sentences.find_effect_title(one)} {format_percent(share)}"
            for one, share in sentences.list_rivals(cause)
        )
    )
    return CauseLine(
        sentences.format_heading(cause),
        diagnosis_words.format_cause_size(cause),
        format_percent(cause.probability),
        rivals,
        diagnosis_words.format_cost(cause, mean_target_kg_ha, units),
        _("Drive the next test before anything is changed.") if tied else _(cause.advice),
        find_interval_shares(cause.size),
        tied,
    )


def find_interval_shares(size: Size) -> tuple[float, float, float] | None:
    """Return low, value and high as shares of a bar with zero in its centre; None without an
    interval."""
    if size.value is None or size.low is None or size.high is None:
        return None
    # The largest of the three numbers fills the bar.
    most = max(abs(size.value), abs(size.low), abs(size.high))
    return (
        (round(size.low / most, 2), round(size.value / most, 2), round(size.high / most, 2))
        if most > 0.0
        else None
    )


def make_channels_view(view: DiagnosisView) -> ChannelsView:
    """Return the channels. The gains are those of the causes; the report has those of the machine
    file."""
    found = view.found
    gains = [
        _(
            "checked on a part of the log kept aside: {channel} off by {before} before, "
            "{after} with it "
            "({metric})"
        ).format(
            channel=sentences.name_channel(gain.channel),
            before=diagnosis_words.format_figure(gain.before),
            after=diagnosis_words.format_figure(gain.after),
            metric=gain.metric,
        )
        for gain in found.gain
        if gain.of == "names"
    ]
    return ChannelsView(
        tuple(_make_channel_line(one, view.after.get(one.channel)) for one in found.channels),
        (*found.findings, *_list_unexplained(found)),
        (*_describe_whole_drive(found), *gains[:MAX_GAIN_LINES]),
        find_language_code(),
    )


def _list_unexplained(found: Diagnosis) -> tuple[str, ...]:
    """Return a sentence about each error that no cause explains."""
    return tuple(
        sentences.describe_unexplained(one, found.data.kind, column=False)
        for one in found.unexplained
    )


def _describe_whole_drive(found: Diagnosis) -> tuple[str, ...]:
    """Return a sentence about the drive as a whole, where a fit of the whole drive was adopted."""
    return (
        ()
        if found.fitted is None
        else (
            f"{sentences.describe_whole(found.fitted)}. "
            f"{sentences.describe_whole_gain(found.fitted)}",
        )
    )


def _make_channel_line(one: Channel, after: float | None) -> ChannelLine:
    """Return one channel in words."""
    # Share of the mean square error that exceeds the sensor's noise.
    # Noise alone gives a share of zero.
    share = 0.0
    if one.structure_p < MAX_STRUCTURE_P and one.rmse > 0.0:
        share = 1.0 - (one.noise_floor / one.rmse) ** 2
    wrong = share >= MIN_MARKED_SHARE
    return ChannelLine(
        sentences.name_channel(one.channel),
        one.unit,
        diagnosis_words.format_figure(one.rmse),
        "" if after is None else diagnosis_words.format_figure(after),
        diagnosis_words.format_figure(one.noise_floor),
        format_percent(share) if wrong else "-",
        wrong,
    )


def make_plan_view(view: DiagnosisView) -> PlanView:
    """Return the plan of the separating run."""
    # A decided diagnosis needs no further run.
    if view.found.next_run is None:
        return PlanView("", (), "", find_language_code())
    names = [
        sentences.find_cause_title(cause)
        for cause in view.found.causes
        if sentences.list_rivals(cause)
    ]
    why = _("Tells apart: {names}.").format(names=", ".join(names)) if names else ""
    how = (
        _(
            "About {minutes} minutes. Drive it and diagnose its log; or try it on the "
            "simulated machine first."
        ).format(minutes=f"{view.minutes:g}")
        if view.drives
        else _("Do it by these steps; it cannot be simulated.")
    )
    return PlanView(why, sentences.list_next_steps(view.found), how, find_language_code())


def make_variable_plot(view: DiagnosisView, at: int) -> PlotView | None:
    """Return the plot over the most informative variable of the chosen cause, or of the unexplained
    part without a cause."""
    return _make_plot_view(view, view.drawn[at].over if view.drawn else view.left_curve)


def make_time_plot(view: DiagnosisView, at: int) -> PlotView | None:
    """Return the plot over time."""
    return _make_plot_view(view, view.drawn[at].time) if view.drawn else None


def _make_plot_view(view: DiagnosisView, curve: ResidualCurve | None) -> PlotView | None:
    """Return the view of a curve, or None."""
    if curve is None:
        return None
    title = _("error of {channel}, {unit}").format(
        channel=sentences.name_channel(curve.channel), unit=curve.unit
    )
    return PlotView(
        title,
        find_variable(curve.variable, view.found.data.kind).label,
        curve,
        not view.drawn,
        find_language_code(),
    )
