"""How is a job reported? The page shows the applied rates by position, the total, the evenness, and
the difference to the target.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from topdress.console.colour_scale import COLOUR_STEPS, find_rate_colour
from topdress.console.reports.chart import (
    AFTER_COLOUR,
    BEFORE_COLOUR,
    LINE_COLOUR,
    ChartSheet,
    ColourBar,
)
from topdress.console.reports.html import (
    Picture,
    escape_text,
    format_facts,
    format_figure,
    format_section,
    make_page,
)
from topdress.console.reports.job_metadata import (
    NO_METADATA,
    JobMetadata,
    draw_time_line,
    format_names,
)
from topdress.console.reports.number_text import format_duration, format_fixed, format_number
from topdress.control.field.width_error import describe_width_error
from topdress.control.geodesy import TangentPlane
from topdress.drivers.files.exports.as_applied import AsApplied

# End of the histogram; larger errors are counted in its outermost bars.
MAX_SHOWN_ERROR_PERCENT = 20.0
# Number of segments up to which a map draws each one.
MAX_DRAWN_SEGMENTS = 4000
# Percentile of the segments with normal effort, low enough for a job that is clogged most of the
# time.
NORMAL_EFFORT_PERCENTILE = 25.0
# A rise of effort is reported from this many standard deviations on. The machine file's tolerance
# gives the standard deviation of a sound drive between runs.
EFFORT_RISE_SD = 2.0
Values = npt.NDArray[np.float64]
TARGET_NOTE = (
    # The note prevents the reading that an error of zero means a perfectly fed crop.
    "<p>The target is what control held for each stretch, in steps. What the crop needed "
    "between the steps "
    "is in no log; a simulated run is held against that too: topdress simulate --summary.</p>"
)


def make_job_page(applied: AsApplied, software: str, about: JobMetadata = NO_METADATA) -> str:
    """Returns a whole HTML page with embedded pictures that fetches nothing, to be handed over."""
    # The verdict line has mass and area, the two numbers that a customer checks first.
    t = applied.totals
    said = (
        f"{format_fixed(t.applied_kg, 1)} kg of {applied.product.name} on "
        f"{format_fixed(applied.worked_ha, 3)} ha"
    )
    sums = format_facts(
        [
            (
                "area worked",
                # Both areas are shown, because a difference between them reveals a wrong width or a
                # lost position.
                f"{format_fixed(applied.worked_ha, 4)} ha, overlaps included, by the places of the "
                "material (by speed "
                f"and time {format_fixed(t.area_ha, 4)} ha)",
            ),
            *(
                ()
                # A log without a coverage raster cannot tell ground from overlaps.
                if t.covered_ha is None or t.overlap_ha is None
                else (
                    (
                        "ground covered",
                        f"{format_fixed(t.covered_ha, 4)} ha, each place once; "
                        f"{format_fixed(t.overlap_ha, 4)} ha passed over "
                        "again",
                    ),
                )
            ),
            *(
                ()
                if t.doses is None
                else (("doses", f"{t.doses}, plants missed: {t.doses_missed or 0}"),)
            ),
            (
                "applied",
                f"{format_fixed(t.applied_kg, 2)} kg, mean {format_number(applied.mean_kg_ha, 4)}"
                f" kg/ha",
            ),
            *(
                ()
                # Less than 5 g would be written as 0.00 kg.
                if t.stopped_kg < 0.005
                else (
                    (
                        "released while stopped",
                        f"{format_fixed(t.stopped_kg, 2)} kg of it, in "
                        f"{len(applied.stopped)} entries of the log",
                    ),
                )
            ),
            (
                "target",
                # Mass that was released while stopped is no error of the rate and is left out of
                # the comparison.
                f"{format_fixed(t.target_kg, 2)} kg; the "
                f"{format_fixed(t.applied_kg - t.stopped_kg, 2)} "
                "kg spread at work are "
                f"{_format_signed(t.error_percent)} % against it"
                if t.error_percent is not None
                else "none logged",
            ),
            *(
                ()
                if applied.cut is None
                else (
                    (
                        "above the crop's limit",
                        f"{format_fixed(applied.cut.area_ha, 4)} ha wanted up to "
                        f"{format_number(applied.cut.highest_kg_ha, 4)} kg/ha; the limit of "
                        f"{format_number(applied.cut.limit_kg_ha, 4)} was "
                        f"applied there, {format_fixed(applied.cut.less_kg, 2)} kg less than "
                        f"wanted",
                    ),
                )
            ),
            (
                "nitrogen",
                f"{format_fixed(t.applied_n_kg, 2)} kg "
                f"({format_fixed(100.0 * applied.product.n_fraction, 1)} % of the "
                "product)",
            ),
            *list_costs(applied, about),
            (
                "evenness",
                f"CV {format_number(t.cv_percent)} %, Christiansen's uniformity "
                f"{format_number(t.cuc_percent)} %",
            ),
            *calc_plan_evenness(applied),
            *(
                ()
                if applied.one_rate is None
                else (
                    (
                        "one rate across the width",
                        escape_text(describe_width_error(applied.one_rate)),
                    ),
                )
            ),
            ("working time", escape_text(format_duration(t.worked_s))),
            (
                "machine",
                escape_text(
                    f"{applied.machine.title or applied.machine.id}, {applied.width_m:g} m"
                ),
            ),
        ]
    )
    # Only a log with GNSS time knows when the job began.
    started = applied.utc(float(applied.stretches.time_s[0]))
    when = "" if started is None else f", {started:%Y-%m-%d %H:%M} UTC"
    # The mark prevents a simulated page from being filed as a record of work.
    simulated = (
        '<p class="simulated">SIMULATED: no material was spread on any ground</p>\n'
        if about.simulated
        else ""
    )
    errors = format_figure(draw_error_histogram(applied))
    return make_page(
        applied.title,
        (
            f"<h1>{escape_text(applied.title + when)}</h1>{simulated}"
            "<p "
            f'class="verdict">{escape_text(said)}</p>'
            f"\n{format_names(about, about.who.product or applied.product.name)}\n"
            f"{format_section('Sums', sums)}\n"
            f"{format_section('Wanted and applied', format_figure(draw_applied_map(applied)))}\n"
            f"{format_effort_section(applied)}"
            f"{format_section('What happened', format_figure(draw_time_line(about)))}\n"
            f"{format_section('Against the target', describe_errors(applied), errors)}\n"
            # The page is handed over on paper too, and both sides sign it.
            f'<p class="signed"><span>handed over by</span><span>received by</span></p>\n'
            f'<p class="dim">{escape_text(software)}</p>'
        ),
    )


def list_costs(applied: AsApplied, about: JobMetadata) -> list[tuple[str, str]]:
    """Returns the costs of the product if the job has its price: in total, per hectare, and of less
    or more than the target."""
    if about.price_per_kg is None:
        return []
    t, price, money = applied.totals, about.price_per_kg, escape_text(about.currency)
    # A job without worked area has no cost per hectare.
    a_hectare = (
        f", {format_fixed(price * t.applied_kg / applied.worked_ha, 2)} {money}/ha"
        if applied.worked_ha > 0.0
        else ""
    )
    off = (
        ""
        if t.error_percent is None
        else (
            f"; against the target "
            f"{_format_signed(price * t.target_kg * t.error_percent / 100.0)} {money}"
        )
    )
    return [
        (
            "cost",
            f"{format_fixed(price * t.applied_kg, 2)} {money}{a_hectare}, at {price:g} {money} a "
            f"kilogram{off}",
        )
    ]


def calc_plan_evenness(applied: AsApplied) -> list[tuple[str, str]]:
    """Returns the evenness of the dose without the plan's own differences.

    It is the r.m.s. of applied minus target, with the target scaled to the total applied, divided
    by the mean applied, weighted by area.
    """
    s = applied.stretches
    # Segments without a target have no plan with which they can be compared.
    known = np.isfinite(s.target_kg_ha) & (s.target_kg_ha > 0.0)
    if not known.any():
        return []
    got, wanted, area = s.applied_kg_ha[known], s.target_kg_ha[known], s.area_m2[known]
    mean = float(np.average(got, weights=area))
    # Scaling to the total applied removes a constant error, so that only unevenness remains.
    scaled = wanted * mean / float(np.average(wanted, weights=area))
    spread = float(np.sqrt(np.average((got - scaled) ** 2, weights=area)))
    return [
        (
            "against the plan",
            f"CV {format_fixed(100.0 * spread / mean, 1)} % once the plan's own differences "
            f"are out",
        )
    ]


def draw_applied_map(applied: AsApplied) -> Picture:
    """Returns the covered ground, coloured by the target rate and by the applied rate on the same
    scale."""
    s = applied.stretches
    # Without any target the map of the wanted rate is omitted, not drawn empty.
    shown = [("wanted", s.target_kg_ha)] * bool(np.isfinite(s.target_kg_ha).any()) + [
        ("applied", s.applied_kg_ha)
    ]
    return Picture(
        _draw_ground_maps(applied, shown, "kg/ha", "Maps of the wanted and of the applied rate"),
        "Wanted and applied rate where the material came to lie, on one scale; the line is "
        "the field's "
        "edge.",
    )


def calc_effort_rise(applied: AsApplied) -> Values:
    """Returns the rise of the metering drive's effort in each segment (n,) over the job's normal
    segments, %; all NaN where unknown.

    An unmeasured machine file shifts all segments equally, so the rise does not depend on it.
    """
    percent = applied.stretches.effort_percent
    return (
        # The quantile ignores missing values: the drive reports no effort while it stands.
        percent - np.nanpercentile(percent, NORMAL_EFFORT_PERCENTILE)
        if np.isfinite(percent).any()
        else percent
    )


def format_effort_section(applied: AsApplied) -> str:
    """Returns where the metering drive's effort rose (stones, clods, wet product); "" where no
    drive reports its effort."""
    rise, s = calc_effort_rise(applied), applied.stretches
    if not np.isfinite(rise).any():
        return ""
    least, worst = (
        EFFORT_RISE_SD * applied.machine.tolerance.effort_percent,
        int(np.nanargmax(rise)),
    )
    place = (
        f"{format_fixed(float(s.lat_deg[worst]), 6)}, {format_fixed(float(s.lon_deg[worst]), 6)}"
    )
    rows = [
        (
            f"more than {least:g} % harder",
            f"{format_fixed(float(s.area_m2[rise > least].sum()) / 10_000.0, 4)} ha",
        ),
        (
            "hardest",
            f"{_format_signed(float(rise[worst]))} % at {place}, {s.time_s[worst]:.0f} s into "
            f"the log",
        ),
    ]
    # Starts and stops would otherwise take the whole range of colours.
    inside = np.clip(rise, *np.nanpercentile(rise, (1.0, 99.0)))
    said = Picture(
        _draw_ground_maps(applied, [("effort", inside)], "% harder", "Map of the drive's effort"),
        "How much harder the metering drive worked than in the easy quarter of the job, at "
        "its speed, "
        "opening and supply: where it rises look for stones, clods, wet product, an outlet "
        "that closes.",
    )
    return format_section(
        "How hard the metering drive worked", format_facts(rows), format_figure(said)
    )


def _draw_ground_maps(
    applied: AsApplied, shown: list[tuple[str, Values]], unit: str, title: str
) -> str:
    """Returns maps of the covered ground next to each other on one scale, as SVG: each value (n,)
    by its segment."""
    s = applied.stretches
    # A plane at the field's middle turns degrees into metres, so both axes have one scale.
    plane = TangentPlane(float(s.lat_deg.mean()), float(s.lon_deg.mean()))
    corners = plane.project_many_to_m(
        s.corners_deg[..., 0].ravel(), s.corners_deg[..., 1].ravel()
    ).reshape(-1, 4, 2)
    # One scale for both maps lets the eye compare their colours.
    known = np.concatenate([values[np.isfinite(values)] for _name, values in shown])
    low, high = float(known.min()), float(known.max())
    colours = [
        "rgb({},{},{})".format(*find_rate_colour(step / (COLOUR_STEPS - 1)))
        for step in range(COLOUR_STEPS)
    ]
    sheet = ChartSheet(6.6, 4.6, columns=len(shown), shares_y=True)
    sheet.colour_bar = ColourBar(low, high, unit, colours)
    for panel, (word, values) in zip(sheet.panels[0], shown, strict=True):
        seen = np.isfinite(values)
        # A constant rate has no range and takes the lowest colour.
        share = (values[seen] - low) / (high - low) if high > low else np.zeros(seen.sum())
        steps = np.round(share * (COLOUR_STEPS - 1)).astype(int)
        panel.draw_ground(corners[seen], [colours[step] for step in steps])
        if applied.field_deg is not None:
            edge = plane.project_many_to_m(applied.field_deg[:, 0], applied.field_deg[:, 1])
            # The first corner is repeated at the end, which closes the edge.
            east_m, north_m = np.vstack((edge, edge[:1])).T
            panel.plot(east_m, north_m, LINE_COLOUR, width=1.0)
        panel.has_equal_scales = True
        panel.label("east, m", "north, m", word)
    return sheet.to_svg(title)


def calc_error_percent(applied: AsApplied) -> tuple[np.ndarray, np.ndarray]:
    """Returns applied divided by target minus one, %, and the area of each, m2; only for segments
    with a target."""
    s = applied.stretches
    known = np.isfinite(s.target_kg_ha) & (s.target_kg_ha > 0.0)
    return 100.0 * (s.applied_kg_ha[known] / s.target_kg_ha[known] - 1.0), s.area_m2[known]


def describe_errors(applied: AsApplied) -> str:
    """Returns errors of the rate in a paragraph of HTML."""
    error, area = calc_error_percent(applied)
    if not len(error):
        return "<p>No target was logged.</p>"
    shares = [
        (
            f"within {limit:g} %",
            f"{format_fixed(100.0 * float(area[np.abs(error) <= limit].sum() / area.sum()), 1)} % "
            "of the area",
        )
        for limit in (2.0, 5.0, 10.0, 20.0)
    ]
    return format_facts(shares) + TARGET_NOTE


def draw_error_histogram(applied: AsApplied) -> Picture | None:
    """Returns a histogram of the errors by area; None without targets."""
    error, area = calc_error_percent(applied)
    if not len(error):
        return None
    sheet = ChartSheet(6.4, 2.8)
    # 41 edges give bars of 1 %.
    edges = np.linspace(-MAX_SHOWN_ERROR_PERCENT, MAX_SHOWN_ERROR_PERCENT, 41)
    # Errors beyond the ends are moved into the outermost bars, so that the bars sum to 100 %.
    inside = np.clip(error, -MAX_SHOWN_ERROR_PERCENT, MAX_SHOWN_ERROR_PERCENT)
    share = np.histogram(inside, edges, weights=area)[0]
    sheet.panel.draw_bars(edges, 100.0 * share / area.sum(), AFTER_COLOUR)
    sheet.panel.draw_moment(0.0, BEFORE_COLOUR, width=1.2, dash="-")
    sheet.panel.label(
        "applied against target, % (outermost bars: and beyond)", "share of the area, %"
    )
    return Picture(
        sheet.to_svg("Distribution of the rate error"), "Rate error by area, stretch by stretch."
    )


def _format_signed(value: float) -> str:
    return ("+" if value > 0.0 else "") + format_fixed(value, 2)
