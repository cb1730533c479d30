"""One page for the owner of machines: worst first by kilograms and money, time lines, what to
do at next service."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import ceil, floor

from topdress.console.locale import N_, _
from topdress.console.reports.chart import AFTER, BEFORE, DIM, ChartSheet, Tick
from topdress.console.reports.html import (
    Picture,
    escape,
    figure,
    format_paragraph,
    items,
    page,
    section,
    table,
)
from topdress.console.reports.numbers import fixed
from topdress.control.diagnosis.season.effect_timelines import Cause, Same, SeasonFit, wears
from topdress.control.diagnosis.season.mixed import Alternative
from topdress.control.diagnosis.season.season_cost import Low, MachineSeason, is_still_there
from topdress.control.machine.machine import CATALOGUE
from topdress.drivers import day_clock

SHOWN = 40  # machines with pictures
MOST_DATES = 7  # along a picture
FACTORS = {
    "product": N_("product"),
    "operator": N_("operator"),
    "field": N_("field"),
    "machine": N_("machine"),
    "fleet": N_("all machines"),
}


def fleet_page(
    machines: Sequence[MachineSeason],
    fit: SeasonFit,
    *,
    low: Sequence[Low],
    units: Mapping[str, str],
    broken: Sequence[tuple[str, str]],
    price: float | None,
    currency: str,
    software: str,
    aside: Sequence[tuple[str, str]] = (),
    by_file_date: int = 0,
) -> str:
    """A whole HTML page. price: of a kilogram; None: no money. aside: path and date of logs
    whose clock was wrong.

    by_file_date: logs that tell no time of their own.
    """
    logs, kg = sum(one.logs for one in machines), sum(one.applied_kg for one in machines)
    wrong = _about(
        sum(one.wrong_kg for one in machines),
        sum(one.least_kg for one in machines),
        sum(one.most_kg for one in machines),
    )
    said = _("{wrong} of {kg} kg were spread too much or too little").format(
        wrong=wrong, kg=fixed(kg, 0)
    )
    head = [
        _("machine"),
        _("logs"),
        _("hours"),
        _("applied, kg"),
        _("spread wrongly, kg"),
        *([] if price is None else [_("money, {currency}").format(currency=currency)]),
        _("dose now by itself, %"),
        _("by operator, product, field, %"),
        _("costliest cause"),
    ]
    rows = [
        [
            one.machine,
            str(one.logs),
            fixed(one.hours, 1),
            fixed(one.applied_kg, 0),
            _about(one.wrong_kg, one.least_kg, one.most_kg, 1),
            *(
                []
                if price is None
                else [_about(price * one.wrong_kg, price * one.least_kg, price * one.most_kg)]
            ),
            _about(one.now_percent, one.now_least, one.now_most, 1, "+z"),
            f"{one.others_percent:+z.1f}",
            describe_costliest(one),
        ]
        for one in machines
    ]
    numbers = frozenset(range(1, len(head) - 1))
    by_file = (
        [
            _(
                "{logs} logs tell no time: that of their files counts, which a copy may "
                "have changed"
            ).format(logs=by_file_date)
        ]
        if by_file_date
        else []
    )
    parts = [
        section(
            _("Machines, worst first"),
            table(head, rows, numbers),
            format_paragraph(
                _(
                    "In brackets: between what it lies where logs cannot tell which of "
                    "several causes it is. What causes "
                    "spread wrongly may add up to more than the machine's kilograms: too "
                    "much by one makes up for too little "
                    "by another."
                ),
                "dim",
            ),
        ),
        section(_("At the next service"), items(service(machines))),
        section(
            _("What logs share"),
            items(
                [
                    *(describe_shared(one, units) for one in fit.shared),
                    *map(describe_same, fit.same),
                    *map(describe_low_hopper, low),
                ]
            ),
        ),
        *_level_tables(fit, units),
        *(
            _of_machine(one, units, number)
            for number, one in enumerate(machines[:SHOWN])
            if any(cost.cause.pieces for cost in one.costs)
        ),
        section(_("Logs without a time"), items([*map(describe_left_out, aside), *by_file])),
        section(
            _("Logs that could not be read"),
            items(why if path in why else f"{path}: {why}" for path, why in broken),
        ),
    ]
    about = _("{machines} machines, {logs} logs").format(machines=len(machines), logs=logs)
    body = "\n".join(part for part in parts if part)
    return page(
        about,
        f'<h1>{escape(about)}</h1>\n<p class="verdict">{escape(said)}</p>\n{body}\n'
        f"{format_paragraph(software, 'dim')}",
    )


def _about(expected: float, least: float, most: float, digits: int = 0, sign: str = "") -> str:
    """What is to be expected, and between what it lies where a set leaves it open."""
    mid, low, high = (
        f"{one:{sign}.{digits}f}" if sign else fixed(one, digits) for one in (expected, least, most)
    )
    return (
        mid if low == mid == high else f"{mid} ({_('{low} to {high}').format(low=low, high=high)})"
    )


def _level_tables(fit: SeasonFit, units: Mapping[str, str]) -> Iterator[str]:
    """Every operator and product of each effect that is reported, the commonest among them,
    with its interval."""
    for effect in sorted({one.effect for one in fit.levels}):
        rows = [
            [
                _factor(one),
                str(one.logs),
                f"{one.size:+z.2f} +- {fixed(one.half, 2)}",
                f"{100.0 * one.probability:.0f}",
                "" if one.apart else _("these logs cannot part it from others"),
            ]
            for one in fit.levels
            if one.effect == effect and one.factor in ("operator", "product")
        ]
        if rows:
            title = f"{titled(effect)}, {_unit(effect, units)}"
            yield section(
                title,
                table(
                    [
                        _("who or what"),
                        _("logs"),
                        _("size, 90 % interval"),
                        _("probability, %"),
                        "",
                    ],
                    rows,
                    frozenset({1, 2, 3}),
                ),
            )


def titled(name: str) -> str:
    """An effect's title; of a member's, with its number."""
    effect_id, _hash, member = name.partition("#")
    title = _(CATALOGUE[effect_id].effect.title)
    return f"{title} {member}" if member else title


def describe_costliest(one: MachineSeason) -> str:
    """What costs a machine most of what is still there, its own or shared; its set of
    alternatives."""
    cause = next((cost.cause for cost in one.costs if is_still_there(cost.cause)), None)
    if cause is None:
        return "-"
    name = set_words(cause)
    return name if cause.pieces else f"{_factor(cause)}: {name}"


def set_words(cause: Cause) -> str:
    """A cause, or all that it may be with their probabilities."""
    if len(cause.alternatives) < 2:
        return titled(cause.effect)
    own = cause.factor, cause.level
    return _(" or ").join(
        f"{titled(one.effect)}"
        f"{'' if (one.factor, one.level) == own else ' (' + _factor(one) + ')'} "
        f"{100.0 * one.probability:.0f} %"
        for one in cause.alternatives
    )


def _factor(one: Cause | Alternative) -> str:
    return f"{_(FACTORS.get(one.factor, one.factor))} {one.level}".strip()


def service(machines: Sequence[MachineSeason]) -> list[str]:
    """What to do, costliest first over all machines; what a product does is done once; what may
    be several things is told apart first."""
    sums = dict[tuple[str, Cause], list[float]]()
    for one in machines:
        for cost in one.costs:
            if is_still_there(cost.cause):
                who = one.machine if cost.cause.pieces else _factor(cost.cause)
                of = sums.setdefault((who, cost.cause), [0.0, 0.0, 0.0])
                of[:] = (of[0] + cost.kg, of[1] + cost.least_kg, of[2] + cost.most_kg)
    return [
        _("{machine}: {advice} ({title}, {kg} kg)").format(
            machine=who,
            advice=_advice(cause),
            title=set_words(cause),
            kg=_about(kg[0], kg[1], kg[2], 1),
        )
        for (who, cause), kg in sorted(sums.items(), key=lambda each: (-each[1][0], -each[1][2]))
    ]


def _advice(cause: Cause) -> str:
    """What it does and what to do; of what may be several things each, to be looked at in turn."""
    sizes = {one.effect: one.size for one in reversed(cause.alternatives)}
    sizes[cause.effect] = cause.now
    said = [
        describe_for_owner(effect, sizes[effect])
        for effect in dict.fromkeys((cause.effect, *cause.alike))
    ]
    if len(said) == 1:
        return said[0]
    return _("find out which it is, likeliest first: {each}").format(each=_(" Or: ").join(said))


def describe_for_owner(effect: str, size: float) -> str:
    """An effect as who owns the machine would say it, and what to do about it."""
    found = CATALOGUE[effect.partition("#")[0]].effect
    return _("{what} {advice}").format(
        what=_(found.sentence(size)).format(size=f"{abs(size):.2g}"), advice=_(found.advice)
    )


def course_words(course: Cause, unit: str, kg: str) -> str:
    """How an effect went over the season, in one sentence. kg: what it spread wrongly."""
    last = course.pieces[-1]
    said = _("{title}: {kg} kg spread wrongly; {size} {unit} +- {half} at the end").format(
        title=titled(course.effect),
        kg=kg,
        size=f"{last.end:+z.2f}",
        half=fixed(last.end_half, 2),
        unit=unit,
    )
    if wears(course):
        said += _(", growing by {slope} {unit} a day (wear)").format(
            slope=f"{last.per_day:+.3f}", unit=unit
        )
    for change in course.changes:
        if change.repair >= 0.5 * change.probability:
            said += _(
                ", repaired or set anew on {date} with {percent} % ({logs} logs after)"
            ).format(
                date=_date(change.time_d),
                percent=f"{100.0 * change.repair:.0f}",
                logs=change.logs_after,
            )
        else:
            said += _(", another from {date} on with {percent} %").format(
                date=_date(change.time_d), percent=f"{100.0 * change.probability:.0f}"
            )
    if len(course.alternatives) > 1:
        said += _("; these logs cannot tell which: {others}").format(others=set_words(course))
    return said


def describe_shared(one: Cause, units: Mapping[str, str]) -> str:
    said = _("{factor}: {title} {size} {unit} +- {half} on every machine ({logs} logs)").format(
        factor=_factor(one),
        title=titled(one.effect),
        size=f"{one.size:+z.2f}",
        half=fixed(one.half, 2),
        unit=_unit(one.effect, units),
        logs=one.logs,
    )
    if len(one.alternatives) > 1:
        said += _("; these logs cannot tell which: {others}").format(others=set_words(one))
    return said


def describe_same(one: Same) -> str:
    return _(
        "{one} and {other} have the same logs: whose doing something is, they cannot tell"
    ).format(
        one=_factor(Alternative(one.factor, one.level, "", 0.0, 0.0)),
        other=_factor(Alternative(one.other_factor, one.other_level, "", 0.0, 0.0)),
    )


def _unit(effect: str, units: Mapping[str, str]) -> str:
    unit = units.get(effect, "")
    return _(unit) if unit else ""


def describe_low_hopper(one: Low) -> str:
    return _(
        "operator {name} works {minutes} min an hour with the hopper nearly empty, the "
        "others {others} "
        "({logs} logs)"
    ).format(
        name=one.operator,
        minutes=fixed(one.minutes_per_hour, 1),
        others=fixed(one.others, 1),
        logs=one.logs,
    )


def describe_left_out(one: tuple[str, str]) -> str:
    path, date = one
    return _(
        "{path}: its clock said {date}: left out of the courses and sums; its true time may "
        "be given "
        "(--about, column time)"
    ).format(path=path, date=date)


def _of_machine(one: MachineSeason, units: Mapping[str, str], number: int) -> str:
    pictures = [
        figure(
            _time_line(
                cost.cause,
                _unit(cost.cause.effect, units),
                _about(cost.kg, cost.least_kg, cost.most_kg, 1),
            )
        )
        for cost in one.costs
        if cost.cause.pieces
    ]
    return section(one.machine, *pictures)


def _time_line(course: Cause, unit: str, kg: str) -> Picture:
    """Each log's size with its interval, and the pieces of the course."""
    said = course_words(course, unit, kg)
    sheet = ChartSheet(7.2, 2.2)
    panel = sheet.panel
    panel.make_x_ticks = _date_ticks
    panel.plot_intervals(
        course.times_d, course.sizes, course.halves, BEFORE, bar_colour=DIM, size=3.0
    )
    for piece in course.pieces:
        ends_d = piece.begin_d, piece.end_d
        panel.plot(ends_d, (piece.begin, piece.end), AFTER, width=2.0)
    panel.draw_level(0.0)
    panel.label("", unit, titled(course.effect))
    return Picture(sheet.to_svg(said), said)


def _date_ticks(low_d: float, high_d: float, most: int) -> list[Tick]:
    """Whole days between two times, days since 1970, at most so many, as dates."""
    every = max(1, ceil((high_d - low_d) / min(most, MOST_DATES)))
    return [(float(day), _date(day)) for day in range(ceil(low_d), floor(high_d) + 1, every)]


def _date(time_d: float) -> str:
    return day_clock.moment(time_d * 86_400.0).date().isoformat()
