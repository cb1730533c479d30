"""Which facts besides the figures does the report of a job contain? They are customer, field,
product, operator, simulation, alarms and refills.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from topdress.console.reports.chart import AFTER_COLOUR, BEFORE_COLOUR, THIRD_COLOUR, ChartSheet
from topdress.console.reports.html import Picture, escape_text, format_facts
from topdress.control.field.job_names import JobNames
from topdress.control.orders import Severity
from topdress.control.safety import ALARMS
from topdress.drivers.files.read_log import RunLog

# Number of kinds of alarms on the time line; the longest are shown.
MAX_ALARM_KINDS = 12


class AlarmSpan(NamedTuple):
    """Holds begin and end of an alarm, s."""

    id: str
    from_s: float
    to_s: float


class JobEvents(NamedTuple):
    """Holds alarms, refills and working spans of a job."""

    alarms: tuple[AlarmSpan, ...] = ()
    # Pairs of time (s) and mass (kg).
    refills: tuple[tuple[float, float], ...] = ()
    # Pairs of begin and end, s.
    working: tuple[tuple[float, float], ...] = ()
    # Note at START that the crop is outside of the stages of its rule; empty inside.
    growth: str = ""


class JobMetadata(NamedTuple):
    """Holds facts of a job besides its figures; empty for unknown facts."""

    who: JobNames = JobNames()
    crop: str = ""
    map: str = ""
    simulated: bool = False
    happened: JobEvents = JobEvents()
    # Price of the product in the job file.
    price_per_kg: float | None = None
    currency: str = ""


NO_METADATA = JobMetadata()


def read_job_metadata(log: RunLog) -> JobMetadata:
    """Returns the facts in the log's sidecar and its rows."""
    meta = log.meta
    job = dict(meta.job or {}) if meta is not None else {}
    crop = dict(meta.crop or {}) if meta is not None else {}

    def read_word(of: dict[str, object], name: str) -> str:
        return str(of.get(name) or "")

    field, target = dict(job.get("field") or {}), dict(job.get("target") or {})
    who = JobNames(
        read_word(job, "client"),
        read_word(job, "farm"),
        read_word(field, "title"),
        read_word(job, "product"),
        read_word(job, "operator"),
    )
    return JobMetadata(
        who,
        read_word(crop, "name"),
        read_word(target, "map").replace("\\", "/").rpartition("/")[2],
        meta is not None and meta.seed is not None,
        find_job_events(log),
        _parse_price(job.get("price_per_kg")),
        read_word(job, "currency"),
    )


def _parse_price(value: object) -> float | None:
    """Returns the price in a sidecar; None without a valid price."""
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else None
    return float(number) if number is not None and isfinite(number) and number >= 0.0 else None


def find_job_events(log: RunLog) -> JobEvents:
    """Returns spans of alarms and of work, and refills, from the rows."""
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
                refills.append((row.time_s, _parse_number_or_zero(value)))
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
    return JobEvents(tuple(spans), tuple(refills), tuple(working), growth)


def _parse_number_or_zero(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def format_names(about: JobMetadata, product: str) -> str:
    """Returns the head of the report; an unknown name is an empty line to be filled in by hand."""
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
    return format_facts(
        [
            (name, escape_text(value) if value else '<span class="blank"></span>')
            for name, value in pairs
            if value or name not in ("Map", "Growth stage")
        ]
    )


def draw_time_line(about: JobMetadata) -> Picture | None:
    """Returns work, refills and each kind of alarm over the job's time; None without alarms and
    refills."""
    happened = about.happened
    if not happened.alarms and not happened.refills:
        return None
    longest: dict[str, float] = {}
    for span in happened.alarms:
        longest[span.id] = longest.get(span.id, 0.0) + span.to_s - span.from_s
    kinds = sorted(longest, key=lambda name: -longest[name])[:MAX_ALARM_KINDS]
    sheet = ChartSheet(6.6, 0.9 + 0.28 * (2 + len(kinds)))
    panel = sheet.panel
    panel.draw_spans([(a / 60.0, b / 60.0) for a, b in happened.working], 0.0, AFTER_COLOUR)
    refills_min = [at / 60.0 for at, _kg in happened.refills]
    panel.plot(refills_min, [1.0] * len(refills_min), THIRD_COLOUR, dash="", marker="v")
    for at_s, kg in happened.refills:
        panel.write(at_s / 60.0, 1.0, f"{kg:.0f} kg")
    for row, name in enumerate(kinds, 2):
        red = name in ALARMS and ALARMS[name].severity is Severity.RED
        spans = [
            (one.from_s / 60.0, max(one.to_s, one.from_s + 1.0) / 60.0)
            for one in happened.alarms
            if one.id == name
        ]
        panel.draw_spans(spans, float(row), BEFORE_COLOUR if red else THIRD_COLOUR)
    rows = ["at work", "refills", *(name.replace("_", " ") for name in kinds)]
    panel.y_names = tuple((float(row), name) for row, name in enumerate(rows))
    panel.y_ends = len(rows) - 0.5, -0.5
    panel.label("time, min")
    return Picture(
        sheet.to_svg("Alarms and refills over the job's time"),
        "Work, refills and alarms; alarms that stopped the flow are in the colour of a warning.",
    )
