"""A diagnosis in one sentence, and its consequences in plain words."""
from __future__ import annotations

from dataclasses import replace

from console.reports.numbers import fixed, number
from console.reports.variables import recorded
from console.reports.words import SOMETHING_ELSE, headlined, not_judged, without_names
from control.diagnosis.result import UNKNOWN, Cause, Diagnosis, FieldCost
from control.machine.machine import CATALOGUE

WORDS = {"none": "nothing found", "named": "named", "ambiguous": "not told apart", "unexplained": "unexplained",
         "not_judged": "not judged"}
PLACE_DIGITS = 2


def title_of(effect_id: str) -> str:
    if effect_id == UNKNOWN:
        return SOMETHING_ELSE
    entry = CATALOGUE.get(effect_id)
    return entry.effect.title if entry else effect_id


def headlines_first(found: Diagnosis) -> Diagnosis:
    """With the causes that are only suspected behind the others."""
    return replace(found, causes=tuple(sorted(found.causes, key=lambda cause: not headlined(cause))))


def sentence(found: Diagnosis) -> str:
    """What was not judged, then the verdict with the causes by name, those left out that are only suspected."""
    missing = not_judged(found.data, [channel.channel for channel in found.channels])
    lead = f"Not judged: {', '.join(missing)}. " if missing and found.verdict != "not_judged" else ""
    return lead + _verdict(found)


def _verdict(found: Diagnosis) -> str:
    clear = [cause for cause in found.causes if headlined(cause)]
    titles = [_small(title_of(cause.id)) for cause in clear]
    named = f"{_count(len(titles))}: {'; '.join(titles)}"
    suspected = len(found.causes) - len(clear)
    more = f" {suspected} more {'is' if suspected == 1 else 'are'} only suspected." if suspected else ""
    plain = without_names(found.verdict, bool(found.channels), len(found.causes), len(clear))
    if plain is not None:
        return plain
    if found.verdict == "named":
        return f"{named}.{more}"
    if found.verdict == "ambiguous":
        doubtful = sum(1 for cause in clear if others(cause))
        which = "It" if len(titles) == 1 else "One of them" if doubtful == 1 else "Some of them"
        doubt = f" {which} could also be something else: this data does not tell." if doubtful else ""
        return f"{named}.{doubt}{more}"
    left = " and ".join(f"{one.channel} depends on {recorded(one.variable, found.data.kind).name}" if one.variable else
                        f"the error of {one.channel} is not noise" for one in found.unexplained) or "something is left"
    along = f" Along with it: {'; '.join(titles)}." if titles else ""
    return f"There is structure that no known effect explains: {left}.{along}{more}"


def others(cause: Cause) -> tuple[tuple[str, float], ...]:
    """Rivals of a cause along with itself, likeliest first."""
    return tuple(sorted(((r.id, r.probability) for r in cause.rivals if r.id != cause.id), key=lambda r: -r[1]))


def cost(of: FieldCost) -> str:
    """What an effect does to dose and place when nobody compensates it."""
    if of.rate_error_percent is None and of.place_error_m is None:
        return "not known"
    said = []
    if of.rate_error_percent:
        word = "much" if of.rate_error_percent > 0.0 else "little"
        said.append(f"{number(abs(of.rate_error_percent), 2)} % too {word} is spread")
    if of.place_error_m and abs(of.place_error_m) >= 0.5 * 10.0 ** -PLACE_DIGITS:
        word = "beyond" if of.place_error_m > 0 else "short of"
        said.append(f"material lands {fixed(abs(of.place_error_m), PLACE_DIGITS)} m {word} its place")
    if of.rate_error_percent is None:
        said.append("dose not known")
    return "; ".join(said) or "nothing in dose or place"


def member_of(cause: Cause) -> str:
    """Which head or outlet, "" where there is no which."""
    if cause.member is None:
        return ""
    stage = cause.id.split(".")[0]
    return f"{'head' if stage == 'canopy' else 'outlet' if stage == 'flow' else 'number'} {cause.member}"


def _count(many: int) -> str:
    words = ("No cause", "One cause", "Two causes", "Three causes", "Four causes")
    return words[many] if many < len(words) else f"{many} causes"


def _small(title: str) -> str:
    return title if title[:2].isupper() or title.startswith(("GNSS", "NDVI")) else title[:1].lower() + title[1:]
