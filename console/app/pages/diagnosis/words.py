"""A diagnosis in the words of the language in use: the verdict in one line, causes, stages. Pure."""
from __future__ import annotations

from math import floor, log10

from console.app.pages.diagnosis.data import (
    IMPORT,
    CauseShown,
    ComparedRow,
    ComparedShown,
    Curve,
    DiagnosisView,
    WholeShown,
)
from console.app.units import Units
from console.app.view import duration
from console.locale import N_, _
from console.reports.variables import recorded
from console.reports.words import as_items, headlined, left_facts, tied, when, without_names
from control.diagnosis.result import Unexplained

VERDICTS = {"none": N_("NOTHING WRONG"), "named": N_("CAUSE NAMED"), "ambiguous": N_("NOT TOLD APART"),
            "unexplained": N_("UNEXPLAINED"), "not_judged": N_("NOT JUDGED")}
VERDICT_SYMBOLS = {"none": "-", "named": "!", "ambiguous": "?", "unexplained": "??", "not_judged": "??"}

KINDS = {"run": N_("run log"), "lag": N_("lag table"), "catch": N_("catch test"), "weigh": N_("weighed plots"),
         "heads": N_("heads table"), "place": N_("place table"), IMPORT: N_("other log")}

STAGES = {"reading": N_("reading the file"), "importing": N_("bringing in the file"),
          "data": N_("looking at the data"), "model": N_("predicting every channel"),
          "shaft": N_("shaft and gate"), "gate": N_("shaft and gate"), "metering": N_("shaft, gate, flow, scale"),
          "flow": N_("flow and scale"), "speed": N_("speeds"), "heads": N_("sensor heads"),
          "result": N_("weighing the causes"), "pictures": N_("drawing"), "report": N_("writing the report"),
          "driving": N_("driving the separating run"), "noise and steps in the times": N_("looking at the data"),
          "search": N_("searching causes"), "what is left": N_("what is left"), "gain": N_("measuring the gain")}

CHANNELS = {"shaft": N_("shaft"), "gate": N_("gate"), "flow": N_("flow"), "scale": N_("scale"), "speed": N_("speed"),
            "heads": N_("heads"), "lag": N_("lag"), "place": N_("place")}

# What stands on a plot's axis, and what is left over: as the reports name it, or as the data's column.
VARIABLES = {
    "shaft speed commanded, r/min": N_("shaft speed commanded, r/min"),
    "opening commanded, mm": N_("opening commanded, mm"), "supply, V": N_("supply, V"),
    "pitch, degrees nose up": N_("pitch, degrees nose up"),
    "roll, degrees right side down": N_("roll, degrees right side down"), "hopper, kg": N_("hopper, kg"),
    "ground speed, m/s": N_("ground speed, m/s"), "heading, degrees": N_("heading, degrees"),
    "time, min": N_("time, min"), "acceleration, m/s per s": N_("acceleration, m/s per s"), "head": N_("head"),
    "NDVI, mean of all heads": N_("NDVI, mean of all heads"),
    "last change of the command": N_("last change of the command"),
    "distance moved so far, mm": N_("distance moved so far, mm"),
    "seconds since the command changed (residual turned so that up is the way of the change)":
        N_("seconds since the command changed"),
    "out of work / in work": N_("out of work / in work"),
    "shaft_rpm": N_("shaft speed, r/min"), "opening_mm": N_("opening, mm"), "supply_v": N_("supply, V"),
    "pitch_deg": N_("pitch, degrees nose up"), "roll_deg": N_("roll, degrees right side down"),
    "hopper_kg": N_("hopper, kg"), "speed_mps": N_("ground speed, m/s"), "heading_deg": N_("heading, degrees"),
    "time_s": N_("time"), "outlet": N_("outlet"), "ndvi_reference": N_("NDVI of the reference"),
    "warm_min": N_("minutes since switched on"), "target_kg": N_("target, kg"), "area_m2": N_("area, m2"),
    "duration_s": N_("duration, s"), "height_m": N_("height, m"), "replicate": N_("replicate"), "label": N_("label"),
    "corrected_lag_s": N_("lag corrected for, s"), "before_rpm": N_("shaft speed before, r/min"),
    "constant": N_("a constant"), "ndvi": N_("NDVI"),
}

RUNS = {
    "stairs": N_("Shaft staircase: 20, 40, 60, 80 r/min for a minute each at one opening, twice."),
    "openings": N_("Opening staircase: 10, 20, 30, 40 mm for a minute each at one shaft speed, twice."),
    "slope": N_("Out and back on a slope, two minutes each way, twice."),
    "two_speeds": N_("Two ground speeds: 3 and 6 km/h in turn, two minutes each."),
    "out_of_work": N_("Drive on with the shaft stopped every second minute."),
    "standing": N_("Stand still with the shaft stopped for ten minutes and watch the scale."),
    "refill": N_("Work for ten minutes, fill up with weighed bags and write the kg down, work for ten more."),
}


def stage_word(stage: str) -> str:
    return _(STAGES.get(stage, stage))


def channel_word(channel: str) -> str:
    return _(CHANNELS.get(channel, channel))


def variable_word(name: str) -> str:
    """An axis or a recorded column in words; its own name where it is not known."""
    return _(VARIABLES.get(name, name))


def about(found: DiagnosisView) -> tuple[str, ...]:
    """Which data, how much of it, and what it was held against."""
    span = "" if found.duration_s is None else f", {duration(found.duration_s)}"
    rows = _("{count} rows").format(count=found.rows)
    against = _("against {machine}").format(machine=found.machine)
    return found.source, f"{_(KINDS.get(found.kind, found.kind))}, {rows}{span}", against


def sentence(found: DiagnosisView) -> str:
    """What was not judged, then the verdict, in one line; where rivals are tied, the test that parts them."""
    if found.verdict == "ambiguous" and found.next_run is not None and any(map(tied, found.causes)):
        return _next_test(found)
    if not found.not_judged or found.verdict == "not_judged":
        return _verdict(found)
    missing = _("Not judged: {channels}.").format(channels=", ".join(map(channel_word, found.not_judged)))
    return f"{missing} {_verdict(found)}"


def _next_test(found: DiagnosisView) -> str:
    """The next test leads: a name that this data cannot tell from others is no headline."""
    assert found.next_run is not None
    steps = as_items(to_do(found))
    first = steps[0] if steps else _("the separating run")
    minutes = f" ({found.next_run.minutes:g} min)" if found.next_run.minutes else ""
    said = [_("Test next: {what}{minutes}.").format(what=first, minutes=minutes)]
    equals = dict.fromkeys(name for cause in found.causes for name, _sure in ties(cause))
    if equals:
        said.append(_("It tells apart: {causes}.").format(causes="; ".join(equals)))
    sure = [title(cause) for cause in found.causes if not tied(cause) and headlined(cause)]
    if sure:
        said.append(_("Sure: {causes}.").format(causes="; ".join(sure)))
    return " ".join(said)


def ties(cause: CauseShown) -> tuple[tuple[str, str], ...]:
    """A cause and its rivals as equals, each with its probability: the data does not prefer one."""
    own = (title(cause), percent(cause.probability))
    return (own, *((_(rival.title), percent(rival.probability)) for rival in cause.rivals)) if tied(cause) else ()


def _verdict(found: DiagnosisView) -> str:
    likely = [cause for cause in found.causes if headlined(cause)]
    suspected = len(found.causes) - len(likely)
    if found.verdict == "unexplained" and found.left:
        said = left(found.left[0])
        return said if not likely else f"{said} {_('Besides:')} {title(likely[0])}."
    verdict = "ambiguous" if found.verdict == "unexplained" else found.verdict     # what is left is not known: causes
    plain = without_names(verdict, bool(found.channels), len(found.causes), len(likely))
    if plain is not None:
        return plain
    said = "   ".join(f"{number}. {_doubtful(cause)}" for number, cause in enumerate(likely, 1)) if (
        len(likely) > 1) else _doubtful(likely[0])
    return f"{said}   {_('Only suspected: {count}.').format(count=suspected)}" if suspected else said


def left(of: Unexplained) -> str:
    """What no effect explains, how much, when."""
    if of.variable:
        said = _("{channel} follows {variable}, and no known cause explains it").format(
            channel=channel_word(of.channel), variable=_(recorded(of.variable, "table").name))
    else:
        said = _("The error of {channel} is not noise, and no known cause explains it").format(
            channel=channel_word(of.channel))
    share = _("{share} of what is left there").format(share=percent(of.explained_share))
    return f"{said}: {'; '.join((share, *left_facts(of)))}."


def whole(of: WholeShown) -> str:
    """A drive fitted as a whole: what of."""
    sizes = ", ".join(f"{_(name)} {number(value)} {_(unit)}" for name, value, unit in of.sizes)
    return _("{channel} as a whole: {sizes}").format(channel=channel_word(of.channel), sizes=sizes)


def whole_gain(of: WholeShown) -> str:
    """What a drive fitted as a whole is good for."""
    return _("Which of these is wrong is not told apart. Adopted together they predict rows that were not fitted to: "
             "error {before} -> {after} {unit}.").format(before=number(of.before), after=number(of.after),
                                                         unit=_(of.unit))


def _doubtful(cause: CauseShown) -> str:
    """One cause, and how many others it could be."""
    if not cause.rivals:
        return _("{first}.").format(first=title(cause))
    if len(cause.rivals) == 1:
        return _("{first}, or: {other}. This data cannot tell.").format(first=title(cause),
                                                                       other=_(cause.rivals[0].title))
    return _("{first}, or one of {count} others: this data cannot tell.").format(first=title(cause),
                                                                                count=len(cause.rivals))


def todo(found: DiagnosisView) -> str:
    """What to do next, in one line."""
    if found.verdict == "none":
        return _("Nothing to do.")
    if found.verdict == "not_judged" and found.channels:
        return _("Record more: longer, and with more different commands. The notes say what would not show.")
    if found.verdict == "not_judged":
        return _("Look at the notes: they say which columns are missing or empty.")
    if found.verdict == "ambiguous" and found.next_run is not None:
        if found.next_run.id:
            return _("V shows its steps, Q7 writes it as a job file, Q5 drives it on the simulated machine.")
        return _("V shows its steps.")
    if found.causes and headlined(found.causes[0]):
        return _(found.causes[0].advice)
    if found.causes:
        return _("Do not act on a suspicion alone: look at the machine, or record more data.")
    if found.whole is not None:
        return _("Q1 adopts the drive as a whole; look for what changed on the machine all the same.")
    return _("Look for what changed on the machine; a smooth curve alone is not adopted.")


def suspicion(cause: CauseShown) -> str:
    """The title, and whether there is more than a suspicion."""
    return title(cause) if headlined(cause) else _("suspected: {title}").format(title=title(cause))


def title(cause: CauseShown) -> str:
    which = "" if cause.member is None else f" {cause.member}"
    return _(cause.title) + which


def adopted_title(found: DiagnosisView, name: str) -> str:
    """Of an id that may be adopted: a cause by its title, a drive as a whole by its sizes, a term by its id."""
    if found.whole is not None and name == found.whole.id:
        return whole(found.whole)
    return next((title(one) for one in found.causes if one.id == name), name)


def number(value: float, digits: int = 3) -> str:
    """As many digits as one reads at a glance, no powers of ten."""
    if value == 0.0 or abs(value) < 1e-6:
        return "0"
    decimals = max(0, min(6, digits - 1 - floor(log10(abs(value)))))
    return f"{value:.{decimals}f}"


def size(cause: CauseShown) -> str:
    """Size, 90 % interval, since when."""
    if cause.value is None:
        said = _("size not known")
    else:
        said = f"{number(cause.value)} {_(cause.unit)}"
        if cause.low is not None and cause.high is not None:
            said += f"  ({number(cause.low, 2)} {_('to')} {number(cause.high, 2)})"
    then = when(cause.onset_s, cause.until_s, cause.grows, cause.value, cause.unit)
    return f"{said}  {then}" if then else said


def cost(cause: CauseShown, units: Units) -> str:
    """What it does to dose and place while nobody knows of it."""
    said = []
    if cause.rate_percent:
        rate = "" if cause.rate_kg_ha is None else f" = {_signed(cause.rate_kg_ha * units.rate.per_si, 0)}"
        named = "" if not rate else f" {units.rate.name}"
        said.append(f"{_signed(cause.rate_percent, 1)} %{rate}{named}")
    if cause.place_m:
        said.append(f"{_signed(cause.place_m * units.fine_distance.per_si, 2)} {units.fine_distance.name}")
    if said:
        return "   ".join(said)
    return _("not known") if cause.rate_percent is None and cause.place_m is None else _("no effect on rate or place")


def _signed(value: float, decimals: int) -> str:
    return f"{value:+.{decimals}f}"


def percent(share: float) -> str:
    """A probability that does not claim certainty."""
    return ">99 %" if share > 0.995 else "<1 %" if share < 0.005 else f"{100.0 * share:.0f} %"


def rivals(cause: CauseShown) -> str:
    return ", ".join(f"{_(rival.title)} {percent(rival.probability)}" for rival in cause.rivals)


def to_do(found: DiagnosisView) -> tuple[str, ...]:
    """What a person does next, one thing after the other; RUNS translated, on the machine that their numbers are of."""
    return tuple(_(step) for step in found.next_run.to_do) if found.next_run is not None else ()


def curve_title(curve: Curve) -> str:
    return _("error of {channel}, {unit}").format(channel=channel_word(curve.channel), unit=curve.unit)


def compared(found: ComparedShown) -> list[str]:
    """A line for each channel: error before and after, and which is better beyond chance."""
    lines = [f"{channel_word(one.channel)}: {number(one.old)} -> {number(one.new)} {one.unit}   {_better(one)}"
             for one in found.rows]
    return lines or [_("no channel of this log could be held against both")]


def _better(one: ComparedRow) -> str:
    if one.low is None or one.high is None:
        return _("the log is too short to say")
    if one.low <= 0.0 <= one.high:
        return _("no difference beyond chance")
    share = f"{100.0 * abs(1.0 - one.new / one.old):.0f}" if one.old > 0.0 else "-"
    words = _("better: {percent} % less error") if one.low > 0.0 else _("worse: {percent} % more error")
    return words.format(percent=share)


def beyond_noise(error: float, noise: float) -> float:
    """Share of a channel's mean square error that is not its sensor's noise, 0 to 1."""
    if error <= 0.0:
        return 0.0
    return max(0.0, 1.0 - (noise / error) ** 2)
