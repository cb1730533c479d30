"""What a handover sheet tells next to the figures: whose job, of what, by whom, simulated or
not; alarms and refills."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from topdress.console.reports.chart import AFTER, BEFORE, THIRD, ChartSheet
from topdress.console.reports.html import Picture, escape, facts
from topdress.control.field.job_names import JobNames
from topdress.control.orders import Severity
from topdress.control.safety import ALARMS
from topdress.drivers.files.read_log import RunLog

MOST_ALARMS = 12  # kinds on the time line; the longest


class AlarmSpan(NamedTuple):
    """An alarm from when to when, s."""

    id: str
    from_s: float
    to_s: float


class Happened(NamedTuple):
    alarms: tuple[AlarmSpan, ...] = ()
    refills: tuple[tuple[float, float], ...] = ()  # s, kg
    working: tuple[tuple[float, float], ...] = ()  # from, to, s
    # as said at START: outside the stages of the crop's rule
    growth: str = ""


class About(NamedTuple):
    """Empty: nobody said so."""

    who: JobNames = JobNames()
    crop: str = ""
    map: str = ""
    simulated: bool = False
    happened: Happened = Happened()
    price_per_kg: float | None = None  # of the product, as the job says
    currency: str = ""


NOBODY = About()


def read_about(log: RunLog) -> About:
    """By the log's sidecar and its rows."""
    meta = log.meta
    job = dict(meta.job or {}) if meta is not None else {}
    crop = dict(meta.crop or {}) if meta is not None else {}

    def said(of: dict[str, object], name: str) -> str:
        return str(of.get(name) or "")

    field, target = dict(job.get("field") or {}), dict(job.get("target") or {})
    who = JobNames(
        said(job, "client"),
        said(job, "farm"),
        said(field, "title"),
        said(job, "product"),
        said(job, "operator"),
    )
    return About(
        who,
        said(crop, "name"),
        said(target, "map").replace("\\", "/").rpartition("/")[2],
        meta is not None and meta.seed is not None,
        happened(log),
        _price(job.get("price_per_kg")),
        said(job, "currency"),
    )


def _price(value: object) -> float | None:
    """As a sidecar has it; what is no price is none."""
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else None
    return float(number) if number is not None and isfinite(number) and number >= 0.0 else None


def happened(log: RunLog) -> Happened:
    """Spans of alarms and of work, and refills, from the rows."""
    stands: dict[str, float] = {}
    spans: list[AlarmSpan] = []
    refills: list[tuple[float, float]] = []
    working: list[tuple[float, float]] = []
    started: float | None = None
    growth = ""
    last_s = 0.0
    for row in log.rows():
        now = {name for name in (row.alarms or "").split(";") if name}
        spans += [
            AlarmSpan(name, stands.pop(name), row.time_s)
            for name in list(stands)
            if name not in now
        ]
        for name in now:
            stands.setdefault(name, row.time_s)
        for event in (row.events or "").split(";"):
            word, _blank, value = event.partition(" ")
            if word == "refill":
                refills.append((row.time_s, _number(value)))
            elif word == "refill_back" and refills:
                refills.pop()
            elif word == "growth_stage_outside":
                growth = value
        if row.state == "working":
            started = row.time_s if started is None else started
        elif started is not None:
            working.append((started, row.time_s))
            started = None
        last_s = row.time_s
    spans += [AlarmSpan(name, since, last_s) for name, since in stands.items()]
    if started is not None:
        working.append((started, last_s))
    return Happened(tuple(spans), tuple(refills), tuple(working), growth)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def named(about: About, product: str) -> str:
    """The sheet's head: what is not known is a line to be filled in by hand."""
    who = about.who
    pairs = [
        ("Client", who.client),
        ("Farm", who.farm),
        ("Field", who.field),
        ("Crop", about.crop),
        ("Product", product),
        ("Operator", who.operator),
        ("Map", about.map),
        (
            "Growth stage",
            f"outside the crop's rule: {about.happened.growth}" if about.happened.growth else "",
        ),
    ]
    return facts(
        [
            (name, escape(value) if value else '<span class="blank"></span>')
            for name, value in pairs
            if value or name not in ("Map", "Growth stage")
        ]
    )


def draw_time_line(about: About) -> Picture | None:
    """Work, refills and each kind of alarm over the job's time; None where nothing happened
    along with the work."""
    happened = about.happened
    if not happened.alarms and not happened.refills:
        return None
    longest: dict[str, float] = {}
    for span in happened.alarms:
        longest[span.id] = longest.get(span.id, 0.0) + span.to_s - span.from_s
    kinds = sorted(longest, key=lambda name: -longest[name])[:MOST_ALARMS]
    sheet = ChartSheet(6.6, 0.9 + 0.28 * (2 + len(kinds)))
    panel = sheet.panel
    panel.draw_spans([(a / 60.0, b / 60.0) for a, b in happened.working], 0.0, AFTER)
    refills_min = [at / 60.0 for at, _kg in happened.refills]
    panel.plot(refills_min, [1.0] * len(refills_min), THIRD, dash="", marker="v")
    for at_s, kg in happened.refills:
        panel.write(at_s / 60.0, 1.0, f"{kg:.0f} kg")
    for row, name in enumerate(kinds, 2):
        red = name in ALARMS and ALARMS[name].severity is Severity.RED
        spans = [
            (one.from_s / 60.0, max(one.to_s, one.from_s + 1.0) / 60.0)
            for one in happened.alarms
            if one.id == name
        ]
        panel.draw_spans(spans, float(row), BEFORE if red else THIRD)
    rows = ["at work", "refills", *(name.replace("_", " ") for name in kinds)]
    panel.y_names = tuple((float(row), name) for row, name in enumerate(rows))
    panel.y_ends = len(rows) - 0.5, -0.5
    panel.label("time, min")
    return Picture(
        sheet.to_svg("Alarms and refills over the job's time"),
        "Work, refills and alarms; alarms that stopped the flow are in the colour of a warning.",
    )
