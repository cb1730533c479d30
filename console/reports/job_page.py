"""The report of a job: what was applied where, how much, how evenly, and how far from the
target."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from topdress.console.reports.chart import AFTER, BEFORE, LINE, ChartSheet, ColourBar
from topdress.console.reports.html import Picture, escape, facts, figure, page, section
from topdress.console.reports.job_about import NOBODY, About, draw_time_line, named
from topdress.console.reports.numbers import fixed, number, span_of
from topdress.console.scale import STEPS, colour
from topdress.control.field.across import describe_across
from topdress.control.geodesy import TangentPlane
from topdress.drivers.files.exports.as_applied import AsApplied

# the histogram's ends; what lies beyond is counted in its outermost bars
ERROR_TO_PERCENT = 20.0
MOST_STRETCHES = 4000  # that a map draws one by one
# per cent of the stretches: of a job that is clogged for most of it the rest is usual
EASY = 25.0
# of what a sound drive is off from run to run, by the machine file's tolerance
ROSE_SD = 2.0
Values = npt.NDArray[np.float64]
HELD_WORDS = (
    "<p>The target is what control held for each stretch, in steps. What the crop needed "
    "between the steps "
    "is in no log; a simulated run is held against that too: topdress simulate --summary.</p>"
)


def job_page(applied: AsApplied, software: str, about: About = NOBODY) -> str:
    """A whole HTML page, pictures inside, nothing fetched from elsewhere: a sheet to hand over."""
    t = applied.totals
    said = (
        f"{fixed(t.applied_kg, 1)} kg of {applied.product.name} on {fixed(applied.worked_ha, 3)} ha"
    )
    sums = facts(
        [
            (
                "area worked",
                f"{fixed(applied.worked_ha, 4)} ha, overlaps included, by the places of the "
                "material (by speed "
                f"and time {fixed(t.area_ha, 4)} ha)",
            ),
            *(
                ()
                if t.covered_ha is None or t.overlap_ha is None
                else (
                    (
                        "ground covered",
                        f"{fixed(t.covered_ha, 4)} ha, each place once; "
                        f"{fixed(t.overlap_ha, 4)} ha passed over "
                        "again",
                    ),
                )
            ),
            *(
                ()
                if t.doses is None
                else (("doses", f"{t.doses}, plants missed: {t.doses_missed or 0}"),)
            ),
            ("applied", f"{fixed(t.applied_kg, 2)} kg, mean {number(applied.mean_kg_ha, 4)} kg/ha"),
            *(
                ()
                if t.stopped_kg < 0.005
                else (
                    (
                        "released while stopped",
                        f"{fixed(t.stopped_kg, 2)} kg of it, in "
                        f"{len(applied.stopped)} entries of the log",
                    ),
                )
            ),
            (
                "target",
                f"{fixed(t.target_kg, 2)} kg; the {fixed(t.applied_kg - t.stopped_kg, 2)} "
                "kg spread at work are "
                f"{_signed(t.error_percent)} % against it"
                if t.error_percent is not None
                else "none logged",
            ),
            *(
                ()
                if applied.cut is None
                else (
                    (
                        "above the crop's limit",
                        f"{fixed(applied.cut.area_ha, 4)} ha wanted up to "
                        f"{number(applied.cut.highest_kg_ha, 4)} kg/ha; the limit of "
                        f"{number(applied.cut.limit_kg_ha, 4)} was "
                        f"applied there, {fixed(applied.cut.less_kg, 2)} kg less than wanted",
                    ),
                )
            ),
            (
                "nitrogen",
                f"{fixed(t.applied_n_kg, 2)} kg "
                f"({fixed(100.0 * applied.product.n_fraction, 1)} % of the "
                "product)",
            ),
            *costs(applied, about),
            (
                "evenness",
                f"CV {number(t.cv_percent)} %, Christiansen's uniformity {number(t.cuc_percent)} %",
            ),
            *evenness_against_plan(applied),
            *(
                ()
                if applied.one_rate is None
                else (("one rate across the width", escape(describe_across(applied.one_rate))),)
            ),
            ("working time", escape(span_of(t.worked_s))),
            (
                "machine",
                escape(f"{applied.machine.title or applied.machine.id}, {applied.width_m:g} m"),
            ),
        ]
    )
    started = applied.utc(float(applied.stretches.time_s[0]))
    when = "" if started is None else f", {started:%Y-%m-%d %H:%M} UTC"
    simulated = (
        '<p class="simulated">SIMULATED: no material was spread on any ground</p>\n'
        if about.simulated
        else ""
    )
    errors = figure(error_histogram(applied))
    return page(
        applied.title,
        (
            f"<h1>{escape(applied.title + when)}</h1>{simulated}"
            "<p "
            f'class="verdict">{escape(said)}</p>'
            f"\n{named(about, about.who.product or applied.product.name)}\n"
            f"{section('Sums', sums)}\n"
            f"{section('Wanted and applied', figure(applied_map(applied)))}\n"
            f"{effort_section(applied)}{section('What happened', figure(draw_time_line(about)))}\n"
            f"{section('Against the target', describe_errors(applied), errors)}\n"
            f'<p class="signed"><span>handed over by</span><span>received by</span></p>\n'
            f'<p class="dim">{escape(software)}</p>'
        ),
    )


def costs(applied: AsApplied, about: About) -> list[tuple[str, str]]:
    """Of the product, where the job says its price: in all, of a hectare worked, and what less
    or more than the target costs."""
    if about.price_per_kg is None:
        return []
    t, price, money = applied.totals, about.price_per_kg, escape(about.currency)
    a_hectare = (
        f", {fixed(price * t.applied_kg / applied.worked_ha, 2)} {money}/ha"
        if applied.worked_ha > 0.0
        else ""
    )
    off = (
        ""
        if t.error_percent is None
        else (
            f"; against the target {_signed(price * t.target_kg * t.error_percent / 100.0)} {money}"
        )
    )
    return [
        (
            "cost",
            f"{fixed(price * t.applied_kg, 2)} {money}{a_hectare}, at {price:g} {money} a "
            f"kilogram{off}",
        )
    ]


def evenness_against_plan(applied: AsApplied) -> list[tuple[str, str]]:
    """How even the dose is once the plan's own differences are taken out: the r.m.s. of applied
    less wanted, wanted scaled to what was applied in all, over the mean applied; by area."""
    s = applied.stretches
    known = np.isfinite(s.target_kg_ha) & (s.target_kg_ha > 0.0)
    if not known.any():
        return []
    got, wanted, area = s.applied_kg_ha[known], s.target_kg_ha[known], s.area_m2[known]
    mean = float(np.average(got, weights=area))
    scaled = wanted * mean / float(np.average(wanted, weights=area))
    spread = float(np.sqrt(np.average((got - scaled) ** 2, weights=area)))
    return [
        (
            "against the plan",
            f"CV {fixed(100.0 * spread / mean, 1)} % once the plan's own differences are out",
        )
    ]


def applied_map(applied: AsApplied) -> Picture:
    """The ground covered, coloured by what was wanted there and, next to it on the same scale,
    by what it got."""
    s = applied.stretches
    shown = [("wanted", s.target_kg_ha)] * bool(np.isfinite(s.target_kg_ha).any()) + [
        ("applied", s.applied_kg_ha)
    ]
    return Picture(
        _ground(applied, shown, "kg/ha", "Maps of the wanted and of the applied rate"),
        "Wanted and applied rate where the material came to lie, on one scale; the line is "
        "the field's "
        "edge.",
    )


def find_effort_rise(applied: AsApplied) -> Values:
    """By how much harder the metering drive worked in each stretch (n,) than in the job's easy
    ones, %: a machine file whose numbers nobody measured moves all alike. All NaN where it is
    not known."""
    percent = applied.stretches.effort_percent
    return percent - np.nanpercentile(percent, EASY) if np.isfinite(percent).any() else percent


def effort_section(applied: AsApplied) -> str:
    """Where the metering drive's effort rose: stones, clods, wet product; "" where no drive
    says."""
    rise, s = find_effort_rise(applied), applied.stretches
    if not np.isfinite(rise).any():
        return ""
    least, worst = ROSE_SD * applied.machine.tolerance.effort_percent, int(np.nanargmax(rise))
    place = f"{fixed(float(s.lat_deg[worst]), 6)}, {fixed(float(s.lon_deg[worst]), 6)}"
    rows = [
        (
            f"more than {least:g} % harder",
            f"{fixed(float(s.area_m2[rise > least].sum()) / 10_000.0, 4)} ha",
        ),
        (
            "hardest",
            f"{_signed(float(rise[worst]))} % at {place}, {s.time_s[worst]:.0f} s into the log",
        ),
    ]
    # starts and stops would take all the colours
    inside = np.clip(rise, *np.nanpercentile(rise, (1.0, 99.0)))
    said = Picture(
        _ground(applied, [("effort", inside)], "% harder", "Map of the drive's effort"),
        "How much harder the metering drive worked than in the easy quarter of the job, at "
        "its speed, "
        "opening and supply: where it rises look for stones, clods, wet product, an outlet "
        "that closes.",
    )
    return section("How hard the metering drive worked", facts(rows), figure(said))


def _ground(applied: AsApplied, shown: list[tuple[str, Values]], unit: str, title: str) -> str:
    """Maps of the ground covered next to each other on one scale, as SVG: each value (n,) by
    its stretch."""
    s = applied.stretches
    plane = TangentPlane(float(s.lat_deg.mean()), float(s.lon_deg.mean()))
    corners = plane.many_to_m(s.corners_deg[..., 0].ravel(), s.corners_deg[..., 1].ravel()).reshape(
        -1, 4, 2
    )
    known = np.concatenate([values[np.isfinite(values)] for _name, values in shown])
    low, high = float(known.min()), float(known.max())
    colours = ["rgb({},{},{})".format(*colour(step / (STEPS - 1))) for step in range(STEPS)]
    sheet = ChartSheet(6.6, 4.6, columns=len(shown), shares_y=True)
    sheet.colour_bar = ColourBar(low, high, unit, colours)
    for panel, (word, values) in zip(sheet.panels[0], shown, strict=True):
        seen = np.isfinite(values)
        share = (values[seen] - low) / (high - low) if high > low else np.zeros(seen.sum())
        steps = np.round(share * (STEPS - 1)).astype(int)
        panel.draw_ground(corners[seen], [colours[step] for step in steps])
        if applied.field_deg is not None:
            edge = plane.many_to_m(applied.field_deg[:, 0], applied.field_deg[:, 1])
            east_m, north_m = np.vstack((edge, edge[:1])).T
            panel.plot(east_m, north_m, LINE, width=1.0)
        panel.has_equal_scales = True
        panel.label("east, m", "north, m", word)
    return sheet.to_svg(title)


def error_percent(applied: AsApplied) -> tuple[np.ndarray, np.ndarray]:
    """Applied over target less one, %, and the area behind each, m2; only where something was
    wanted."""
    s = applied.stretches
    known = np.isfinite(s.target_kg_ha) & (s.target_kg_ha > 0.0)
    return 100.0 * (s.applied_kg_ha[known] / s.target_kg_ha[known] - 1.0), s.area_m2[known]


def describe_errors(applied: AsApplied) -> str:
    error, area = error_percent(applied)
    if not len(error):
        return "<p>No target was logged.</p>"
    shares = [
        (
            f"within {limit:g} %",
            f"{fixed(100.0 * float(area[np.abs(error) <= limit].sum() / area.sum()), 1)} % "
            "of the area",
        )
        for limit in (2.0, 5.0, 10.0, 20.0)
    ]
    return facts(shares) + HELD_WORDS


def error_histogram(applied: AsApplied) -> Picture | None:
    error, area = error_percent(applied)
    if not len(error):
        return None
    sheet = ChartSheet(6.4, 2.8)
    edges = np.linspace(-ERROR_TO_PERCENT, ERROR_TO_PERCENT, 41)
    inside = np.clip(error, -ERROR_TO_PERCENT, ERROR_TO_PERCENT)
    share = np.histogram(inside, edges, weights=area)[0]
    sheet.panel.draw_bars(edges, 100.0 * share / area.sum(), AFTER)
    sheet.panel.draw_moment(0.0, BEFORE, width=1.2, dash="-")
    sheet.panel.label(
        "applied against target, % (outermost bars: and beyond)", "share of the area, %"
    )
    return Picture(
        sheet.to_svg("Distribution of the rate error"), "Rate error by area, stretch by stretch."
    )


def _signed(value: float) -> str:
    return ("+" if value > 0.0 else "") + fixed(value, 2)
