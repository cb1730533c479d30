"""One page for the owner of machines: worst first by kilograms and money, time lines, what to do at next service."""
from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence

import numpy as np

from console.locale import N_, _
from console.reports.figure import AFTER, BEFORE, DIM, drawn, svg
from console.reports.html import escape, figure, items, page, paragraph, section, table
from console.reports.numbers import fixed
from console.reports.page_style import STYLE
from console.reports.picture import Picture
from control.diagnosis.season.courses import Course, Shared
from control.diagnosis.season.owner import Low, MachineSeason, repaired_d, wears
from control.machine.machine import CATALOGUE

SHOWN = 40                  # machines with pictures
MOST_DATES = 7              # along a picture
FACTORS = {"product": N_("product"), "operator": N_("operator"), "field": N_("field")}


def fleet_page(machines: Sequence[MachineSeason], shared: Sequence[Shared], *, low: Sequence[Low],
               units: Mapping[str, str], broken: Sequence[tuple[str, str]], price: float | None, currency: str,
               software: str, aside: Sequence[tuple[str, str]] = (), by_file_date: int = 0) -> str:
    """A whole HTML page. price: of a kilogram; None: no money. aside: path and date of logs whose clock was wrong.

    by_file_date: logs that tell no time of their own. Needs matplotlib.
    """
    logs, kg = sum(one.logs for one in machines), sum(one.applied_kg for one in machines)
    wrong = sum(one.wrong_kg for one in machines)
    said = _("{wrong} of {kg} kg were spread too much or too little").format(wrong=fixed(wrong, 0), kg=fixed(kg, 0))
    head = [_("machine"), _("logs"), _("hours"), _("applied, kg"), _("spread wrongly, kg"),
            *([] if price is None else [_("money, {currency}").format(currency=currency)]), _("dose now, %"),
            _("costliest cause")]
    rows = [[one.machine, str(one.logs), fixed(one.hours, 1), fixed(one.applied_kg, 0), fixed(one.wrong_kg, 1),
             *([] if price is None else [fixed(price * one.wrong_kg, 0)]), f"{one.now_percent:+.1f}",
             costliest(one)] for one in machines]
    numbers = frozenset(range(1, len(head) - 1))
    parts = [
        section(_("Machines, worst first"), table(head, rows, numbers)),
        section(_("At the next service"), items(service(machines))),
        section(_("What logs share"), items([*(shared_words(one, units) for one in shared), *map(low_words, low)])),
        *(_of_machine(one, units, number) for number, one in enumerate(machines[:SHOWN]) if one.courses),
        section(_("Logs without a time"), items([*map(aside_words, aside), *by_file_words(by_file_date)])),
        section(_("Logs that could not be read"),
                items(why if path in why else f"{path}: {why}" for path, why in broken)),
    ]
    about = _("{machines} machines, {logs} logs").format(machines=len(machines), logs=logs)
    body = "\n".join(part for part in parts if part)
    return page(about, STYLE, f'<h1>{escape(about)}</h1>\n<p class="verdict">{escape(said)}</p>\n{body}\n'
                              f'{paragraph(software, "dim")}')


def titled(name: str) -> str:
    """An effect's title; of a member's, with its number."""
    effect_id, _hash, member = name.partition("#")
    title = _(CATALOGUE[effect_id].effect.title)
    return f"{title} {member}" if member else title


def costliest(one: MachineSeason) -> str:
    """What costs a machine most, of its own or of what its logs share."""
    causes = [*((kg, titled(course.effect)) for course, kg in one.courses),
              *((kg, f"{_factor(shared)}: {titled(shared.effect)}") for shared, kg in one.shared)]
    return max(causes, key=lambda each: each[0])[1] if causes else "-"


def _factor(one: Shared) -> str:
    return f"{_(FACTORS.get(one.factor, one.factor))} {one.level}"


def service(machines: Sequence[MachineSeason]) -> list[str]:
    """What to do, costliest first over all machines; what a product does is done once."""
    every = [(kg, one.machine, course.effect) for one in machines for course, kg in one.courses if _over(course)]
    of_level: dict[Shared, float] = {}
    for one in machines:
        for shared, kg in one.shared:
            of_level[shared] = of_level.get(shared, 0.0) + kg
    every += [(kg, _factor(shared), shared.effect) for shared, kg in of_level.items()]
    return [_("{machine}: {advice} ({title}, {kg} kg)").format(
        machine=who, advice=_(CATALOGUE[effect.partition("#")[0]].effect.advice), title=titled(effect),
        kg=fixed(kg, 1)) for kg, who, effect in sorted(every, key=lambda each: -each[0])]


def _over(course: Course) -> bool:
    """Whether it is still there at the end."""
    last = course.pieces[-1]
    return abs(last.end) > last.end_half + course.open_half


def course_words(course: Course, unit: str) -> str:
    """How an effect went over the season, in one sentence."""
    last = course.pieces[-1]
    half = float(np.hypot(last.end_half, course.open_half))
    said = _("{title}: {size} {unit} +- {half} at the end").format(
        title=titled(course.effect), size=f"{last.end:+.2f}", half=fixed(half, 2), unit=unit)
    if wears(course):
        said += _(", growing by {slope} a day (wear)").format(slope=f"{last.per_day:+.3f}")
    for time_d in repaired_d(course):
        said += _(", less from {date} on (repair or new setting)").format(date=_date(time_d))
    if course.alike:
        said += _("; these logs cannot tell it from {others}").format(others=", ".join(map(titled, course.alike)))
    return said


def shared_words(one: Shared, units: Mapping[str, str]) -> str:
    return _("{factor} {level}: {title} {size} {unit} +- {half} on every machine ({logs} logs)").format(
        factor=_(FACTORS.get(one.factor, one.factor)), level=one.level, title=titled(one.effect),
        size=f"{one.size:+.2f}", half=fixed(one.half, 2), unit=_unit(one.effect, units), logs=one.logs)


def _unit(effect: str, units: Mapping[str, str]) -> str:
    unit = units.get(effect, "")
    return _(unit) if unit else ""


def low_words(one: Low) -> str:
    return _("operator {name} works {minutes} min an hour with the hopper nearly empty, the others {others} "
             "({logs} logs)").format(name=one.operator, minutes=fixed(one.minutes_per_hour, 1),
                                     others=fixed(one.others, 1), logs=one.logs)


def aside_words(one: tuple[str, str]) -> str:
    path, date = one
    return _("{path}: its clock said {date}: left out of the courses and sums; its true time may be told "
             "(--about, column time)").format(path=path, date=date)


def by_file_words(logs: int) -> list[str]:
    """Nothing where all logs tell their time."""
    return [_("{logs} logs tell no time: that of their files counts, which a copy may have changed").format(logs=logs)
            ] if logs else []


def _of_machine(one: MachineSeason, units: Mapping[str, str], number: int) -> str:
    pictures = [figure(_time_line(course, _unit(course.effect, units), f"m{number}c{k}"))
                for k, (course, _kg) in enumerate(one.courses)]
    return section(one.machine, *pictures)


def _time_line(course: Course, unit: str, name: str) -> Picture:
    """Each log's size with its interval, and the pieces of the course."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
    said = course_words(course, unit)
    with drawn(7.2, 2.2) as (drawing, axes):
        plot, days = axes[0][0], [dt.datetime.fromtimestamp(one * 86_400.0, dt.UTC) for one in course.times_d]
        plot.errorbar(days, course.sizes, course.half, fmt="o", color=BEFORE, ecolor=DIM, markersize=3.0, linewidth=0.8)
        for piece in course.pieces:
            ends = [dt.datetime.fromtimestamp(one * 86_400.0, dt.UTC) for one in (piece.begin_d, piece.end_d)]
            plot.plot(ends, [piece.begin, piece.end], color=AFTER, linewidth=2.0)
        plot.axhline(0.0, color=DIM, linewidth=0.8)
        dates = AutoDateLocator(minticks=2, maxticks=MOST_DATES)
        plot.xaxis.set_major_locator(dates)
        plot.xaxis.set_major_formatter(ConciseDateFormatter(dates))
        plot.set_ylabel(unit)
        plot.set_title(titled(course.effect))
        return Picture(svg(drawing, name, escape(said)), said)


def _date(time_d: float) -> str:
    return dt.datetime.fromtimestamp(time_d * 86_400.0, dt.UTC).date().isoformat()
