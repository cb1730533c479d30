"""How does an owner of machines see a season? One page lists machines by kilograms and money lost,
their time lines, and the steps of the next service.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import ceil, floor

from topdress.console.locale import N_, _
from topdress.console.reports.chart import AFTER_COLOUR, BEFORE_COLOUR, DIM_COLOUR, ChartSheet, Tick
from topdress.console.reports.html import (
    Picture,
    escape_text,
    format_figure,
    format_list,
    format_paragraph,
    format_section,
    format_table,
    make_page,
)
from topdress.console.reports.number_text import format_fixed
from topdress.control.diagnosis.season.effect_timelines import (
    InseparableLevels,
    SeasonCause,
    SeasonFit,
    is_wearing,
)
from topdress.control.diagnosis.season.mixed_model import Alternative
from topdress.control.diagnosis.season.season_cost import (
    LowHopperOperator,
    MachineCost,
    is_still_there,
)
from topdress.control.machine.machine import CATALOGUE
from topdress.drivers import day_clock

# Number of machines with pictures.
# The machines are sorted by loss: the cheapest get a row of the table and no picture.
MAX_PICTURED_MACHINES = 40
# Number of dates along a picture.
# Seven dates fit below a picture of 7.2 inches without touching each other.
MAX_DATES = 7
# The keys are the factors of the season's fit; only the values are translated.
FACTOR_NAMES = {
    "product": N_("product"),
    "operator": N_("operator"),
    "field": N_("field"),
    "machine": N_("machine"),
    "fleet": N_("all machines"),
}


def make_fleet_page(
    machines: Sequence[MachineCost],
    fit: SeasonFit,
    *,
    low: Sequence[LowHopperOperator],
    units: Mapping[str, str],
    broken: Sequence[tuple[str, str]],
    price: float | None,
    currency: str,
    software: str,
    aside: Sequence[tuple[str, str]] = (),
    by_file_date: int = 0,
) -> str:
    """Returns a whole HTML page.

    `price` is the price of a kilogram; None omits money. `aside` has path and date of logs with a
    wrong clock. `by_file_date` is the number of logs without a time of their own.
    """
    logs, kg = sum(one.logs for one in machines), sum(one.applied_kg for one in machines)
    # Ranges are summed end by end: the widest range that the machines' ranges allow.
    wrong = _format_expected(
        sum(one.wrong_kg for one in machines),
        sum(one.least_kg for one in machines),
        sum(one.most_kg for one in machines),
    )
    said = _("{wrong} of {kg} kg were spread too much or too little").format(
        wrong=wrong, kg=format_fixed(kg, 0)
    )
    head = [
        _("machine"),
        _("logs"),
        _("hours"),
        _("applied, kg"),
        _("spread wrongly, kg"),
        # Without a price the column is absent: a column of zeros would suggest that nothing was
        # lost.
        *([] if price is None else [_("money, {currency}").format(currency=currency)]),
        _("dose now by itself, %"),
        _("by operator, product, field, %"),
        _("costliest cause"),
    ]
    rows = [
        [
            one.machine,
            str(one.logs),
            format_fixed(one.hours, 1),
            format_fixed(one.applied_kg, 0),
            _format_expected(one.wrong_kg, one.least_kg, one.most_kg, 1),
            *(
                []
                if price is None
                else [
                    _format_expected(
                        price * one.wrong_kg, price * one.least_kg, price * one.most_kg
                    )
                ]
            ),
            _format_expected(one.now_percent, one.now_least, one.now_most, 1, "+z"),
            f"{one.others_percent:+z.1f}",
            describe_costliest(one),
        ]
        for one in machines
    ]
    # The first column and the last hold words and are aligned left.
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
        format_section(
            _("Machines, worst first"),
            format_table(head, rows, numbers),
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
        format_section(_("At the next service"), format_list(list_service_steps(machines))),
        format_section(
            _("What logs share"),
            format_list(
                [
                    *(describe_shared(one, units) for one in fit.shared),
                    *map(describe_same, fit.same),
                    *map(describe_low_hopper, low),
                ]
            ),
        ),
        *_make_level_tables(fit, units),
        # Only the costliest machines get pictures.
        *(
            _format_machine(one, units, number)
            for number, one in enumerate(machines[:MAX_PICTURED_MACHINES])
            # A machine whose causes have no time course has nothing to draw.
            if any(cost.cause.pieces for cost in one.costs)
        ),
        format_section(
            _("Logs without a time"), format_list([*map(describe_left_out, aside), *by_file])
        ),
        format_section(
            _("Logs that could not be read"),
            # A reason that already contains the path is not preceded by the path again.
            format_list(why if path in why else f"{path}: {why}" for path, why in broken),
        ),
    ]
    about = _("{machines} machines, {logs} logs").format(machines=len(machines), logs=logs)
    body = "\n".join(part for part in parts if part)
    return make_page(
        about,
        f'<h1>{escape_text(about)}</h1>\n<p class="verdict">{escape_text(said)}</p>\n{body}\n'
        f"{format_paragraph(software, 'dim')}",
    )


def _format_expected(
    expected: float, least: float, most: float, digits: int = 0, sign: str = ""
) -> str:
    """Returns the expected value, and its range where a set of causes leaves it open."""
    # "+z" prints a sign and turns -0 into +0, so that a zero never looks like a loss.
    mid, low, high = (
        f"{one:{sign}.{digits}f}" if sign else format_fixed(one, digits)
        for one in (expected, least, most)
    )
    return (
        mid if low == mid == high else f"{mid} ({_('{low} to {high}').format(low=low, high=high)})"
    )


def _make_level_tables(fit: SeasonFit, units: Mapping[str, str]) -> Iterator[str]:
    """Yields every operator and product of each reported effect, the most frequent marked, with its
    interval."""
    # Effects are sorted by id, so that two runs write identical pages.
    for effect in sorted({one.effect for one in fit.levels}):
        rows = [
            [
                _format_factor(one),
                str(one.logs),
                f"{one.size:+z.2f} +- {format_fixed(one.half, 2)}",
                f"{100.0 * one.probability:.0f}",
                "" if one.apart else _("these logs cannot part it from others"),
            ]
            # Machines and fields have their own sections; here people and products are compared.
            for one in fit.levels
            if one.effect == effect and one.factor in ("operator", "product")
        ]
        if rows:
            title = f"{find_member_title(effect)}, {_translate_unit(effect, units)}"
            yield format_section(
                title,
                format_table(
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


def find_member_title(name: str) -> str:
    """Returns an effect's title; for an effect of one head or outlet with its number."""
    # Members are ids such as canopy.gain#2 for head 2.
    effect_id, _hash, member = name.partition("#")
    title = _(CATALOGUE[effect_id].effect.title)
    return f"{title} {member}" if member else title


def describe_costliest(one: MachineCost) -> str:
    """Returns the costliest present cause of a machine, its own or shared; or its set of
    alternatives."""
    # Costs are sorted by kilograms, so the first present cause is the costliest.
    cause = next((cost.cause for cost in one.costs if is_still_there(cost.cause)), None)
    if cause is None:
        return "-"
    name = describe_alternatives(cause)
    return name if cause.pieces else f"{_format_factor(cause)}: {name}"


def describe_alternatives(cause: SeasonCause) -> str:
    """Returns a cause, or all alternatives with their probabilities."""
    if len(cause.alternatives) < 2:
        return find_member_title(cause.effect)
    own = cause.factor, cause.level
    return _(" or ").join(
        # An alternative under another operator or product carries this name, since only the effect
        # is equal.
        f"{find_member_title(one.effect)}"
        f"{'' if (one.factor, one.level) == own else ' (' + _format_factor(one) + ')'} "
        f"{100.0 * one.probability:.0f} %"
        for one in cause.alternatives
    )


def _format_factor(one: SeasonCause | Alternative) -> str:
    return f"{_(FACTOR_NAMES.get(one.factor, one.factor))} {one.level}".strip()


def list_service_steps(machines: Sequence[MachineCost]) -> list[str]:
    """Returns the steps of the next service, costliest first over all machines. A product's step is
    listed once; a set of alternatives is separated first."""
    sums = dict[tuple[str, SeasonCause], list[float]]()
    for one in machines:
        for cost in one.costs:
            if is_still_there(cost.cause):
                # A shared cause belongs to its product or operator, whose step is listed only once.
                who = one.machine if cost.cause.pieces else _format_factor(cost.cause)
                of = sums.setdefault((who, cost.cause), [0.0, 0.0, 0.0])
                of[:] = (of[0] + cost.kg, of[1] + cost.least_kg, of[2] + cost.most_kg)
    return [
        _("{machine}: {advice} ({title}, {kg} kg)").format(
            machine=who,
            advice=_describe_advice(cause),
            title=describe_alternatives(cause),
            kg=_format_expected(kg[0], kg[1], kg[2], 1),
        )
        # Equal expected masses are ordered by the larger upper end.
        for (who, cause), kg in sorted(sums.items(), key=lambda each: (-each[1][0], -each[1][2]))
    ]


def _describe_advice(cause: SeasonCause) -> str:
    """Returns the effect of a cause and its remedy; for alternatives each of them, to be checked in
    turn."""
    # The list is reversed so that the likeliest alternative of an effect overwrites less likely
    # ones.
    sizes = {one.effect: one.size for one in reversed(cause.alternatives)}
    sizes[cause.effect] = cause.final_size
    said = [
        describe_for_owner(effect, sizes[effect])
        for effect in dict.fromkeys((cause.effect, *cause.other_effects))
    ]
    if len(said) == 1:
        return said[0]
    return _("find out which it is, likeliest first: {each}").format(each=_(" Or: ").join(said))


def describe_for_owner(effect: str, size: float) -> str:
    """Returns an effect in the words of the machine's owner, and its remedy."""
    # The member is cut off, because all heads share the advice of their effect.
    found = CATALOGUE[effect.partition("#")[0]].effect
    return _("{what} {advice}").format(
        what=_(found.choose_sentence(size)).format(size=f"{abs(size):.2g}"), advice=_(found.advice)
    )


def describe_course(course: SeasonCause, unit: str, kg: str) -> str:
    """Returns the time course of an effect over the season, in one sentence. `kg` is the mass that
    was misapplied because of it."""
    last = course.pieces[-1]
    said = _("{title}: {kg} kg spread wrongly; {size} {unit} +- {half} at the end").format(
        title=find_member_title(course.effect),
        kg=kg,
        size=f"{last.end:+z.2f}",
        half=format_fixed(last.end_half, 2),
        unit=unit,
    )
    if is_wearing(course):
        said += _(", growing by {slope} {unit} a day (wear)").format(
            slope=f"{last.per_day:+.3f}", unit=unit
        )
    for change in course.changes:
        # A change is called a repair if at least half of its probability points to one.
        if change.repair >= 0.5 * change.probability:
            said += _(
                ", repaired or set anew on {date} with {percent} % ({logs} logs after)"
            ).format(
                date=_format_date(change.time_d),
                percent=f"{100.0 * change.repair:.0f}",
                logs=change.logs_after,
            )
        else:
            said += _(", another from {date} on with {percent} %").format(
                date=_format_date(change.time_d), percent=f"{100.0 * change.probability:.0f}"
            )
    if len(course.alternatives) > 1:
        said += _("; these logs cannot tell which: {others}").format(
            others=describe_alternatives(course)
        )
    return said


def describe_shared(one: SeasonCause, units: Mapping[str, str]) -> str:
    """Returns a shared effect in one sentence."""
    said = _("{factor}: {title} {size} {unit} +- {half} on every machine ({logs} logs)").format(
        factor=_format_factor(one),
        title=find_member_title(one.effect),
        size=f"{one.size:+z.2f}",
        half=format_fixed(one.half, 2),
        unit=_translate_unit(one.effect, units),
        logs=one.logs,
    )
    if len(one.alternatives) > 1:
        said += _("; these logs cannot tell which: {others}").format(
            others=describe_alternatives(one)
        )
    return said


def describe_same(one: InseparableLevels) -> str:
    """Returns two levels of a factor with the same logs, in one sentence."""
    return _(
        "{one} and {other} have the same logs: whose doing something is, they cannot tell"
    ).format(
        one=_format_factor(Alternative(one.factor, one.level, "", 0.0, 0.0)),
        other=_format_factor(Alternative(one.other_factor, one.other_level, "", 0.0, 0.0)),
    )


def _translate_unit(effect: str, units: Mapping[str, str]) -> str:
    unit = units.get(effect, "")
    return _(unit) if unit else ""


def describe_low_hopper(one: LowHopperOperator) -> str:
    """Returns an operator who works with a nearly empty hopper, in one sentence."""
    return _(
        "operator {name} works {minutes} min an hour with the hopper nearly empty, the "
        "others {others} "
        "({logs} logs)"
    ).format(
        name=one.operator,
        minutes=format_fixed(one.minutes_per_hour, 1),
        others=format_fixed(one.others, 1),
        logs=one.logs,
    )


def describe_left_out(one: tuple[str, str]) -> str:
    """Returns a log with a wrong clock, in one sentence."""
    path, date = one
    return _(
        "{path}: its clock said {date}: left out of the courses and sums; its true time may "
        "be given "
        "(--about, column time)"
    ).format(path=path, date=date)


def _format_machine(one: MachineCost, units: Mapping[str, str], number: int) -> str:
    pictures = [
        format_figure(
            _draw_course(
                cost.cause,
                _translate_unit(cost.cause.effect, units),
                _format_expected(cost.kg, cost.least_kg, cost.most_kg, 1),
            )
        )
        for cost in one.costs
        if cost.cause.pieces
    ]
    return format_section(one.machine, *pictures)


def _draw_course(course: SeasonCause, unit: str, kg: str) -> Picture:
    """Returns a picture of each log's size with its interval, and of the pieces of the
    time course."""
    said = describe_course(course, unit, kg)
    sheet = ChartSheet(7.2, 2.2)
    panel = sheet.panel
    panel.make_x_ticks = _make_date_ticks
    panel.plot_intervals(
        # Intervals of single logs stay dim, so that the fitted course in colour stands out.
        course.times_d,
        course.sizes,
        course.halves,
        BEFORE_COLOUR,
        bar_colour=DIM_COLOUR,
        size=3.0,
    )
    for piece in course.pieces:
        ends_d = piece.begin_d, piece.end_d
        panel.plot(ends_d, (piece.begin, piece.end), AFTER_COLOUR, width=2.0)
    # The zero line is the machine as its file describes it.
    panel.draw_level(0.0)
    panel.label("", unit, find_member_title(course.effect))
    return Picture(sheet.to_svg(said), said)


def _make_date_ticks(low_d: float, high_d: float, most: int) -> list[Tick]:
    """Returns whole days between two times (days since 1970), at most `most`, as dates."""
    every = max(1, ceil((high_d - low_d) / min(most, MAX_DATES)))
    return [(float(day), _format_date(day)) for day in range(ceil(low_d), floor(high_d) + 1, every)]


def _format_date(time_d: float) -> str:
    # The season's fit counts time in days since 1970; a day has 86,400 s.
    return day_clock.convert_to_utc(time_d * 86_400.0).date().isoformat()
