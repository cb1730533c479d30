"""Words a diagnosis on its page: data, next step by its keys, numbers in the units in use. Pure.

`console.reports.diagnosis_wording` words the findings themselves, for pages and reports alike.
"""

from __future__ import annotations

from topdress.console.app.pages.diagnosis.service import IMPORT_KIND, ComparisonView, DiagnosisView
from topdress.console.app.panel_views import format_duration
from topdress.console.app.units import Units
from topdress.console.locale import N_, _
from topdress.console.reports.diagnosis_wording import (
    describe_improvement,
    describe_time_span,
    describe_whole,
    find_cause_title,
    format_whole_id,
    is_headline,
    name_channel,
)
from topdress.console.reports.number_text import format_number, use_plain_minus
from topdress.control.diagnosis.result import Cause

# Words for the kinds of data.
KIND_NAMES = {
    "run": N_("run log"),
    "lag": N_("lag table"),
    "catch": N_("catch test"),
    "weigh": N_("weighed plots"),
    "heads": N_("heads table"),
    "place": N_("place table"),
    IMPORT_KIND: N_("other log"),
}

# Words for the stages of the work, by the names that `control.diagnosis` reports.
STAGE_NAMES = {
    "reading": N_("reading the file"),
    "importing": N_("bringing in the file"),
    "installing": N_("installing the diagnosis"),
    "data": N_("looking at the data"),
    "model": N_("predicting every channel"),
    "shaft": N_("shaft and gate"),
    "gate": N_("shaft and gate"),
    "metering": N_("shaft, gate, flow, scale"),
    "flow": N_("flow and scale"),
    "gate_effort": N_("gate's effort"),
    "speed": N_("speeds"),
    "heads": N_("sensor heads"),
    "result": N_("weighing the causes"),
    "pictures": N_("drawing"),
    "report": N_("writing the report"),
    "driving": N_("driving the separating run"),
    "noise and steps in the times": N_("looking at the data"),
    "search": N_("searching causes"),
    "what is left": N_("what is left"),
    "gain": N_("measuring the gain"),
}

# Smaller errors of place, m, are not mentioned.
MIN_PLACE_ERROR_M = 0.005


def format_figure(value: float, digits: int = 3) -> str:
    """Return a number with three digits, without powers of ten, and with a minus sign that every
    terminal has."""
    return use_plain_minus(format_number(value, digits))


def describe_data(view: DiagnosisView) -> tuple[str, ...]:
    """Return the data, its extent, and the machine of the comparison."""
    data = view.found.data
    # A bench table has no duration.
    span = "" if data.duration_s is None else f", {format_duration(data.duration_s)}"
    rows = _("{count} rows").format(count=data.rows)
    against = _("against {machine}").format(machine=data.machine)
    return view.source, f"{_(KIND_NAMES.get(data.kind, data.kind))}, {rows}{span}", against


def describe_next_step(view: DiagnosisView) -> str:
    """Return the next step in one line."""
    found = view.found
    if found.verdict == "none":
        return _("Nothing to do.")
    # With channels the log was readable but too short.
    if found.verdict == "not_judged" and found.channels:
        return _(
            "Record more: longer, and with more different commands. The notes say what "
            "would not show."
        )
    if found.verdict == "not_judged":
        return _("Look at the notes: they say which columns are missing or empty.")
    if found.verdict == "ambiguous" and found.next_run is not None:
        # The keys are named only if the simulated machine can drive the run.
        if view.drives:
            return _(
                "V shows its steps, Q7 writes it as a job file, Q5 drives it on the "
                "simulated machine."
            )
        return _("V shows its steps.")
    # Advice follows a decided cause only.
    if found.causes and is_headline(found.causes[0]):
        return _(found.causes[0].advice)
    if found.causes:
        return _("Do not act on a suspicion alone: look at the machine, or record more data.")
    if found.fitted is not None:
        return _(
            "Q1 adopts the drive as a whole; look for what changed on the machine all the same."
        )
    return _("Look for what changed on the machine; a smooth curve alone is not adopted.")


def find_adopted_title(view: DiagnosisView, name: str) -> str:
    """Return the title of an id that may be adopted: a cause by its title, a fitted drive by its
    sizes, a term by its id."""
    fitted = view.found.fitted
    if fitted is not None and name == format_whole_id(fitted):
        return describe_whole(fitted)
    return next((find_cause_title(one) for one in view.found.causes if one.id == name), name)


def format_cause_size(cause: Cause) -> str:
    """Return size, 90 % interval and time span of a cause."""
    # A cause may start within the log.
    of, then = cause.size, describe_time_span(cause)
    if of.value is None:
        said = _("size not known")
    else:
        said = f"{format_figure(of.value)} {_(of.unit)}"
        if of.low is not None and of.high is not None:
            said += f"  ({format_figure(of.low, 2)} {_('to')} {format_figure(of.high, 2)})"
    return f"{said}  {then}" if then else said


def format_cost(cause: Cause, mean_target_kg_ha: float | None, units: Units) -> str:
    """Return the effect on dose (also at the log's mean target) and on place while the cause stays
    undetected."""
    percent_, place_m = cause.field_cost.rate_error_percent, cause.field_cost.place_error_m
    said = []
    # A zero error needs no text of its own.
    if percent_:
        rate = (
            ""
            if mean_target_kg_ha is None
            else (
                f" = {percent_ * mean_target_kg_ha / 100.0 * units.rate.per_si:+.0f} "
                f"{units.rate.name}"
            )
        )
        said.append(f"{percent_:+.1f} %{rate}")
    if place_m is not None and abs(place_m) >= MIN_PLACE_ERROR_M:
        said.append(f"{place_m * units.fine_distance.per_si:+.2f} {units.fine_distance.name}")
    if said:
        return "   ".join(said)
    return (
        _("not known") if percent_ is None and place_m is None else _("no effect on rate or place")
    )


def list_compared_lines(found: ComparisonView) -> list[str]:
    """Return a line per channel: error before and after, and which of both is significantly
    smaller."""
    lines = [
        f"{name_channel(one.channel)}: {format_figure(one.old)} -> {format_figure(one.new)} "
        f"{one.unit}   "
        f"{describe_improvement(one.old, one.new, one.low, one.high)}"
        for one in found.rows
    ]
    return lines or [_("no channel of this log could be held against both")]
