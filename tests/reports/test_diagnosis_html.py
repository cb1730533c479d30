"""The page: everything in it, nothing fetched by it, hostile words harmless."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from html import escape, unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.console.app.pages.diagnosis import panel_views
from topdress.console.app.units import METRIC
from topdress.console.locale import ENGLISH_CODE, use_language
from topdress.console.reports import html
from topdress.console.reports.diagnosis_html import make_diagnosis_page
from topdress.console.reports.diagnosis_text import summarise_terminal
from topdress.console.reports.diagnosis_wording import (
    describe_field_cost,
    describe_time_span,
    format_verdict_line,
    is_headline,
)
from topdress.console.reports.fleet_page import make_fleet_page
from topdress.console.reports.paper_page import make_paper_page
from topdress.console.reports.run_pictures import draw_cause
from topdress.console.reports.run_views import ChannelView, list_effect_instances, make_run_views
from topdress.console.services.diagnosis_view import make_diagnosis_view
from topdress.control.calibration.bench_table import BenchTable
from topdress.control.diagnosis.result import (
    UNKNOWN,
    Cause,
    Channel,
    Diagnosis,
    FieldCost,
    Rival,
    Size,
    UnexplainedCurve,
    UnexplainedStructure,
    UnnamedEffect,
)
from topdress.control.diagnosis.season.effect_timelines import SeasonFit
from topdress.control.machine.machine import CATALOGUE, Machine

from tests.command import topdress
from topdress import console

OF_RUNS = [i for i, e in CATALOGUE.items() if "run" in " ".join(e.effect.seen_in)]
EMPTY = frozenset({"meta", "line", "circle", "rect", "br", "path", "use"})
HOSTILE = '<script>alert("1")</script>&\'$x_1$.csv'
OF_TABLES = {
    "lag": ("lag.offset", "lag.rebound", "lag.coarse_clock", "shaft.dead_time", "lag.speed_scale"),
    "catch": ("flow.gain", "flow.fill_falloff", "flow.zero_offset"),
    "weigh": ("flow.gain", "scale.gain"),
    "heads": ("canopy.head_fouled", "canopy.saturation"),
    "place": ("place.lever_arm", "place.latency"),
}


class Reader(HTMLParser):
    """Tags opened and left open, addresses, and the words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.ids: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in EMPTY:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "data", "action", "poster", "srcset"):
                self.addresses.append(value or "")
            if name == "id":
                self.ids.append(value or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in EMPTY:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in EMPTY:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    def said(self) -> str:
        return " ".join(" ".join(self.words).split())


def harmless(text: str) -> Reader:
    """Reads the page and holds it to fetching nothing and running nothing."""
    read = Reader(text)
    assert read.open == []
    assert not set(read.tags) & {
        "script",
        "link",
        "iframe",
        "object",
        "embed",
        "img",
        "image",
        "base",
        "form",
        "metadata",
    }
    assert all(address.startswith("#") for address in read.addresses)
    assert {address[1:] for address in read.addresses} <= set(read.ids)
    assert len(read.ids) == len(set(read.ids))
    assert all(where.startswith("#") for where in re.findall(r"url\(([^)]*)\)", text))
    assert "@import" not in text and "http:" not in text and "https:" not in text
    assert not re.search(r"\son\w+=", text)
    return read


def test_page_holds_everything(
    full: Diagnosis, run_columns: dict[str, Any], machine: Machine
) -> None:
    text = make_diagnosis_page(
        full,
        {
            "columns": run_columns,
            "machine": machine,
            "date": "2026-05-01",
            "sha256": "ab12",
            "version": "9.9",
        },
    )
    read = harmless(text)
    said = read.said()
    for cause in full.causes:
        entry = CATALOGUE[cause.id].effect
        for words in (cause.id, entry.title, entry.physics, cause.advice):
            assert words in said
    for words in (
        "Not told apart".lower(),
        "shaft.load_droop",
        "21 %",
        "shaft.dead_band",
        "7 %",
        "4.0 to 6.0",
        "head 3",
        "since 130 s",
        "5.9 % too little is spread",
        "0.25 m beyond its place",
        "Stairs, twice",
        "Refill by bags",
        "0.2868",
        "0.2830 to 0.2910",
        "blocks 2, 5, 7 of 8",
        "-9999",
        "0.27 %",
        "gate.stuck",
        "ab12",
        "9.9",
        "2026-05-01",
        "huanghai",
    ):
        assert words in said, words
    assert (
        said.index("shaft.voltage_sag")
        < said.index("canopy.head_fouled")
        < said.index("flow.blocked_outlet")
    )
    assert text.count("<figure>") == 4
    assert text.count("onset") >= 1


def test_the_same_page_twice(
    bench_tables: dict[str, BenchTable],
    machine: Machine,
    cause_of: Callable[..., Cause],
    found_of: Callable[..., Diagnosis],
) -> None:
    tools = {"tables": [bench_tables["weigh"]], "machine": machine}
    found = found_of(cause_of("flow.gain"), kind="weigh")
    assert make_diagnosis_page(found, tools) == make_diagnosis_page(found, tools)


@pytest.mark.parametrize("kind", OF_TABLES)
def test_each_kind_of_table(
    kind: str,
    bench_tables: dict[str, BenchTable],
    machine: Machine,
    cause_of: Callable[..., Cause],
    found_of: Callable[..., Diagnosis],
) -> None:
    causes = [cause_of(effect_id) for effect_id in OF_TABLES[kind]]
    left = (
        UnexplainedStructure(
            "place"
            if kind == "place"
            else "lag"
            if kind == "lag"
            else "heads"
            if kind == "heads"
            else "flow",
            "target_kg"
            if kind == "weigh"
            else "ndvi_reference"
            if kind == "heads"
            else "shaft_rpm",
            0.4,
        ),
    )
    text = make_diagnosis_page(
        found_of(*causes, kind=kind, unexplained=left),
        {"tables": [bench_tables[kind]], "machine": machine},
    )
    said = harmless(text).said()
    assert all(cause.id in said for cause in causes)
    assert text.count("<figure>") == 2 + ("lag.coarse_clock" in OF_TABLES[kind])


def test_two_tables_and_nothing_found(
    bench_tables: dict[str, BenchTable], machine: Machine, found_of: Callable[..., Diagnosis]
) -> None:
    found = found_of(kind="lag+place")
    text = make_diagnosis_page(
        found, {"tables": [bench_tables["lag"], bench_tables["place"]], "machine": machine}
    )
    said = harmless(text).said()
    assert "Everything is as the machine file says" in said and "lag and place table" in said
    assert text.count("<figure>") == 2
    assert "What was found" not in said and "with the causes" not in said


@pytest.fixture(scope="module")
def views(run_columns: dict[str, Any], machine: Machine) -> tuple[ChannelView, ...]:
    return make_run_views(run_columns, machine)


@pytest.mark.parametrize(
    "effect_id",
    [
        one if number % 3 == 0 else pytest.param(one, marks=pytest.mark.exam)
        for number, one in enumerate(OF_RUNS)
    ],
)
def test_every_effect_of_a_run_has_its_picture(
    effect_id: str, views: tuple[ChannelView, ...], cause_of: Callable[..., Cause]
) -> None:
    part = list_effect_instances([cause_of(effect_id)])[0]
    pictures = draw_cause(views, [part], part)
    # This log has no refill, nothing turns backwards in it, all heads warm up alike, and no
    # drive tells its effort.
    if (
        effect_id in ("flow.batch", "shaft.back_gain", "shaft.back_zone", "canopy.warm_up")
        or "effort." in effect_id
    ):
        return
    assert len(pictures) == 1
    read = harmless(pictures[0].svg)
    assert "nominal machine" in read.said() and "with the causes" in read.said()
    assert "NaN" not in pictures[0].svg and "nan" not in re.findall(
        r'[ "](nan)[ ,"]', pictures[0].svg
    )


def test_unexplained_shows_the_smooth_function(
    run_columns: dict[str, Any], machine: Machine, found_of: Callable[..., Diagnosis]
) -> None:
    nodes = tuple(np.linspace(12.3, 13.7, 8).tolist())
    fit = UnexplainedCurve("shaft", "supply_v", nodes, tuple(5.0 * (x - 13.5) for x in nodes))  # type: ignore[arg-type]
    found = found_of(
        verdict="unexplained",
        unexplained=(UnexplainedStructure("shaft", "supply_v", 0.9),),
        tables=(fit,),
    )
    said = harmless(make_diagnosis_page(found, {"columns": run_columns, "machine": machine})).said()
    for words in (
        "shaft changes with supply (supply_v)",
        "90 %",
        "smooth function",
        "shaft more than nominal, %",
    ):
        assert words in said


def test_hostile_words_stay_words(
    full: Diagnosis,
    bench_tables: dict[str, BenchTable],
    machine: Machine,
    cause_of: Callable[..., Cause],
    found_of: Callable[..., Diagnosis],
) -> None:
    lag = bench_tables["lag"]
    label = np.array([HOSTILE, "中文 label"] * 6)
    found = found_of(
        cause_of("lag.offset", advice=HOSTILE),
        kind="lag",
        findings=(HOSTILE,),
        extended_machine=HOSTILE,
        not_shown=(UnnamedEffect(HOSTILE, full.not_shown[0].smallest_detectable),),
    )
    found = replace(found, data=replace(found.data, path=HOSTILE, machine=HOSTILE))
    text = make_diagnosis_page(
        found,
        {
            "tables": [replace(lag, path=HOSTILE, label=label, label_column=HOSTILE)],
            "machine": machine,
            "date": HOSTILE,
            "version": HOSTILE,
            "sha256": HOSTILE,
        },
    )
    said = harmless(text).said()
    assert "<script" not in text
    assert said.count(HOSTILE) >= 9
    assert escape(HOSTILE) in text and unescape(escape(HOSTILE)) == HOSTILE
    drawn = text[
        text.index('<svg class="picture"') : text.index(
            "</svg>", text.index('<svg class="picture"')
        )
    ]
    assert HOSTILE in Reader(drawn).said() and "中文" in Reader(drawn).said()


def test_checksum_is_of_the_file(
    tmp_path: Path,
    bench_tables: dict[str, BenchTable],
    machine: Machine,
    found_of: Callable[..., Diagnosis],
) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(b"abc")
    found = found_of(kind="lag")
    found = replace(found, data=replace(found.data, path=str(path)))
    text = make_diagnosis_page(found, {"tables": [bench_tables["lag"]], "machine": machine})
    assert "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad" in text
    assert "sha256" not in make_diagnosis_page(
        found_of(kind="lag"), {"tables": [bench_tables["lag"]], "machine": machine}
    )


def test_sentences(
    cause_of: Callable[..., Cause], found_of: Callable[..., Diagnosis], full: Diagnosis
) -> None:
    assert format_verdict_line(found_of()).startswith("Everything is as the machine file says")
    assert (
        format_verdict_line(found_of(cause_of("flow.gain")))
        == "Kilograms per revolution off by a factor."
    )
    assert format_verdict_line(full).startswith(
        "Test next: Stairs, twice (10 min). It tells apart: Shaft loses speed when "
    )
    assert describe_field_cost(FieldCost(None, None)) == "not known"
    assert describe_field_cost(FieldCost(0.0, 0.0)) == "nothing in dose or place"
    assert (
        describe_field_cost(FieldCost(2.04, -0.3))
        == "2.0 % too much is spread; material lands 0.30 m short of its place"
    )


def test_each_of_two_causes_has_a_picture_of_its_own(
    views: tuple[ChannelView, ...], cause_of: Callable[..., Cause]
) -> None:
    """What each takes away from what the other leaves: both on one axis, they were one picture
    twice."""
    parts = list_effect_instances([cause_of("shaft.gain"), cause_of("shaft.voltage_sag")])
    one, other = (draw_cause(views, parts, part)[0] for part in parts)
    assert one.svg != other.svg
    for picture in (one, other):
        said = harmless(picture.svg).said()
        assert "with the other causes" in said and "nominal machine" not in said


@pytest.mark.exam
def test_a_log_of_one_command_has_a_report(tmp_path: Path) -> None:
    """Nothing in it moves but time."""
    rng, log = np.random.default_rng(1), tmp_path / "held-log.csv"
    log.write_text(
        "time_s,shaft_rpm_cmd,shaft_rpm\n"
        + "".join(f"{0.1 * k:.1f},900,{860 + 5 * rng.standard_normal():.2f}\n" for k in range(600))
    )
    machine, out = tmp_path / "m.yaml", tmp_path / "r.html"
    machine.write_text(
        "format: topdress-machine/1\nid: held\nstages: [shaft]\nshaft: {full_rpm: 1000, "
        "acceleration_rpm_s: 1.0e+6, dead_time_s: 0, time_constant_s: 0.05}\n"
        "limits: {shaft_low_rpm: 0, shaft_high_rpm: 1000}\nnoise: {shaft_rpm: 5}\n"
    )
    done = topdress("diagnose", log, "--machine", machine, "--report", out)
    assert done.exit_code in (0, 1) and out.exists(), done.output
    assert "shaft" in harmless(out.read_text(encoding="utf-8")).said()


def test_command_writes_the_report(tmp_path: Path) -> None:
    data, out = tmp_path / "a <b>.csv", tmp_path / "r.html"
    rows = [
        f"{rpm},{2.2118 - 0.0083 * rpm + 0.4 + 0.01 * ((3 * k) % 5 - 2):.3f}"
        for k, rpm in enumerate(range(10, 71, 5))
    ]
    data.write_text("shaft_rpm,lag_s\n" + "\n".join(rows) + "\n")
    result = topdress("diagnose", data, "--report", out)
    assert result.exit_code == 0, result.output
    said = harmless(out.read_text(encoding="utf-8")).said()
    assert "lag.offset" in said and "a <b>.csv" in said


# --- One head for all pages of reports: nothing is fetched or run, whoever wrote the words in
# them -------------------

SOURCES = sorted(Path(console.__file__).parent.rglob("*.py"))


def test_every_page_may_fetch_nothing() -> None:
    for text in (
        html.make_page("<script>", "<p>said</p>", "p {}"),
        make_paper_page([], "topdress"),
        make_fleet_page(
            [],
            SeasonFit(),
            low=[],
            units={},
            broken=(),
            price=None,
            currency="CNY",
            software="topdress",
        ),
    ):
        head = text.partition("</head>")[0].lower()
        assert "default-src 'none'" in head and head.index("content-security-policy") < head.index(
            "<title>"
        )
        assert "<script>" not in text


def test_no_report_has_a_head_of_its_own() -> None:
    heads = [
        path.name for path in SOURCES if "<!doctype" in path.read_text(encoding="utf-8").lower()
    ]
    assert heads == ["html.py"]


def test_pictures_that_stand_in_a_page_are_shown() -> None:
    """The scale of colours beside a map is a picture in the page itself."""
    policy = html.make_page("", "", "").partition("Content-Security-Policy")[2].partition(">")[0]
    assert "img-src data:" in policy and "http" not in policy and "*" not in policy


# --- The same facts of a diagnosis on terminal, report, Diagnosis page and in JSON; in both
# languages ----------------

CHANNELS = tuple(
    Channel(name, unit, 2000, 0.0, 0.4, 0.1, 0.9, 0.5)
    for name, unit in (
        ("shaft", "r/min"),
        ("gate", "mm"),
        ("flow", "kg/s"),
        ("scale", "kg"),
        ("speed", "m/s"),
        ("heads", "NDVI"),
    )
)
LEFT_OUT = "stage gate is left out: column opening_mm_cmd is missing or nearly empty"
GATE = Size(0.8, 0.6, 1.0, "mm")


@pytest.fixture(autouse=True)
def english() -> Iterator[None]:
    use_language(ENGLISH_CODE)
    yield
    use_language(ENGLISH_CODE)


def spoken(found: Diagnosis) -> dict[str, str]:
    """What each of them says, in one line of words."""
    text = make_diagnosis_page(found, {"machine": Machine()})
    on_page = make_diagnosis_view(found, {"machine": Machine()}, "run.csv", None)
    said, causes, channels = (
        panel_views.make_verdict(on_page, ""),
        panel_views.make_causes_view(on_page, 0, METRIC),
        panel_views.make_channels_view(on_page),
    )
    lines = [
        said.word,
        said.sentence,
        said.todo,
        *(words for one in causes.causes for words in one if isinstance(words, str)),
        *causes.calm,
        *channels.left,
    ]
    return {
        "terminal": _flat("\n".join(summarise_terminal(found))),
        "report": _flat(unescape(re.sub(r"<[^>]*>", " ", text[text.index("<body>") :]))),
        "page": _flat("\n".join(lines)),
    }


def _flat(text: str) -> str:
    return " ".join(text.split())


KINDS: dict[str, tuple[dict[str, Any], list[dict[str, Any]], tuple[str, ...], tuple[str, ...]]] = {
    # name: (of the diagnosis, its causes, facts in English, in Chinese)
    "none": ({}, [], (), ()),
    "since": ({}, [{"onset_s": 300.0}], ("since 300 s",), ("从第 300 秒起",)),
    "span": (
        {},
        [{"onset_s": 200.0, "until_s": 320.0}],
        ("from 200 s to 320 s",),
        ("从第 200 秒到第 320 秒",),
    ),
    "ended": ({}, [{"until_s": 320.0}], ("until 320 s",), ("到第 320 秒为止",)),
    "grows": (
        {},
        [{"onset_s": 304.0, "grows": True}],
        ("grows from 304 s on to 0.8 mm at the end",),
        ("从第 304 秒起增大，到结束时为 0.8 mm",),
    ),
    "suspected": (
        {"verdict": "ambiguous"},
        [{"probability": 0.49, "rivals": (Rival(UNKNOWN, 0.5),)}],
        ("something else", "no cause is likely enough to be named"),
        ("其他原因", "没有足够可能的原因可以指明"),
    ),
    "noise": (
        {
            "verdict": "unexplained",
            "unexplained": (
                UnexplainedStructure(
                    "gate", "", 0.9, 0.43, 0.1, "mm", 2.5, "gate.offset", 310.0, 56.0
                ),
            ),
        },
        [],
        (
            "typically off by 0.43 mm; the sensors alone are off by 0.10 mm",
            "2.5 % of the dose",
            "comes and goes every 56 s",
            "nearest: gate.offset, whose evidence does not hold",
            "seems to begin at 310 s",
        ),
        (
            "一般偏差 0.43 mm；仅传感器为 0.10 mm",
            "占施肥量的 2.5 %",
            "每 56 秒起伏一次",
            "最接近的是 gate.offset，但其证据不成立",
            "似从第 310 秒开始",
        ),
    ),
    "variable": (
        {
            "verdict": "unexplained",
            "unexplained": (
                UnexplainedStructure("shaft", "supply_v", 0.4, 1.2, 0.25, "r/min", -3.0),
            ),
        },
        [],
        ("typically off by 1.20 r/min; the sensors alone are off by 0.25 r/min", "3 % of the dose"),
        ("一般偏差 1.20 r/min；仅传感器为 0.25 r/min", "占施肥量的 3 %"),
    ),
    "missing": (
        {"channels": CHANNELS[:1] + CHANNELS[2:], "findings": (LEFT_OUT,)},
        [],
        (LEFT_OUT,),
        (LEFT_OUT,),
    ),
    "not judged": (
        {"verdict": "not_judged", "channels": (), "findings": (LEFT_OUT,)},
        [],
        (LEFT_OUT,),
        (LEFT_OUT,),
    ),
}


@pytest.fixture
def of_kind(
    cause_of: Callable[..., Cause], found_of: Callable[..., Diagnosis]
) -> Callable[[str], Diagnosis]:
    def made(kind: str) -> Diagnosis:
        of_all, causes, _english, _chinese = KINDS[kind]
        return found_of(
            *(cause_of("gate.offset", **{"size": GATE, **one}) for one in causes),
            **{"channels": CHANNELS, **of_all},
        )

    return made


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_facts_everywhere(kind: str, of_kind: Callable[[str], Diagnosis]) -> None:
    for where, said in spoken(of_kind(kind)).items():
        assert [
            fact
            for fact in KINDS[kind][2]
            if fact.lower() not in said.lower()
            and not (where == "terminal" and fact.startswith("no cause"))
        ] == [], where
        others = {fact for one in KINDS.values() for fact in one[2]} - set(KINDS[kind][2])
        assert [fact for fact in others if fact in said] == [], where


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_facts_in_chinese(kind: str, of_kind: Callable[[str], Diagnosis]) -> None:
    use_language("zh")
    said = spoken(of_kind(kind))["page"]
    assert [fact for fact in KINDS[kind][3] if fact not in said] == []


@pytest.mark.parametrize("kind", KINDS)
def test_json_holds_every_field_that_is_said(
    kind: str, of_kind: Callable[[str], Diagnosis]
) -> None:
    found = of_kind(kind)
    data = json.loads(json.dumps(found.to_json()))
    assert [UnexplainedStructure(**one) for one in data["unexplained"]] == list(found.unexplained)
    assert [
        (one["onset_s"], one["until_s"], one["grows"], [rival["id"] for rival in one["rivals"]])
        for one in data["causes"]
    ] == [
        (one.onset_s, one.until_s, one.grows, [rival.id for rival in one.rivals])
        for one in found.causes
    ]


@pytest.mark.parametrize("kind", ["missing", "not judged"])
def test_what_was_not_judged_comes_before_all_else(
    kind: str, of_kind: Callable[[str], Diagnosis], cause_of: Callable[..., Cause]
) -> None:
    found = of_kind(kind)
    found = replace(
        found,
        causes=(cause_of("flow.gain"),),
        verdict="named" if kind == "missing" else "not_judged",
    )
    said = spoken(found)
    for where in ("terminal", "report"):
        assert said[where].index(LEFT_OUT) < said[where].index(found.causes[0].advice)
    lines = summarise_terminal(found)
    missing = "gate" if kind == "missing" else "shaft, gate, flow, scale, speed, heads"
    assert lines[1:3] == [f"not judged: {missing}", f"note: {LEFT_OUT}"]
    on_page = make_diagnosis_view(found, {"machine": Machine()}, "run.csv", None)
    assert panel_views.make_channels_view(on_page).left[0] == LEFT_OUT
    if kind == "missing":
        assert panel_views.make_verdict(on_page, "").sentence.startswith("Not judged: gate. ")
        assert format_verdict_line(found).startswith("Not judged: gate. ")


def test_a_cause_less_likely_than_not_is_in_no_headline(
    cause_of: Callable[..., Cause], found_of: Callable[..., Diagnosis]
) -> None:
    weak = cause_of("gate.offset", size=GATE, probability=0.49, rivals=(Rival(UNKNOWN, 0.5),))
    even = replace(weak, probability=0.5)
    strong = cause_of("shaft.voltage_sag", probability=0.9)
    assert [is_headline(one) for one in (weak, replace(weak, rivals=()), even, strong)] == [
        False,
        False,
        False,
        True,
    ]
    found = found_of(weak, strong, verdict="ambiguous", channels=CHANNELS)
    titles = [CATALOGUE[one.id].effect.title for one in (strong, weak)]
    on_page = found_of_page(found)
    for head in (format_verdict_line(found), panel_views.make_verdict(on_page, "").sentence):
        assert titles[0].lower() in head.lower() and titles[1].lower() not in head.lower()
        assert "suspected" in head
    for said in spoken(found).values():
        assert said.lower().index(titles[0].lower()) < said.lower().index(titles[1].lower())
        assert re.search(
            r"suspected: (gate.offset: )?" + re.escape(titles[1].lower()), said.lower()
        )
    alone = found_of_page(replace(found, causes=(weak,)))
    assert CATALOGUE[weak.id].effect.advice != panel_views.make_verdict(alone, "").todo


def found_of_page(found: Diagnosis, mean_target_kg_ha: float | None = None) -> Any:
    return make_diagnosis_view(found, {"machine": Machine()}, "run.csv", mean_target_kg_ha)


def test_a_size_that_grows_is_said_with_its_sign_and_without_needless_zeros(
    cause_of: Callable[..., Cause],
) -> None:
    grown = cause_of("gate.offset", size=Size(-12.0, None, None, "%"), onset_s=304.0, grows=True)
    assert describe_time_span(grown) == "grows from 304 s on to -12 % at the end"
    assert (
        describe_time_span(replace(grown, size=Size(None, None, None, "%")))
        == "grows from 304 s on to its size at the end"
    )
    assert describe_time_span(replace(grown, onset_s=None, grows=False)) == ""


@pytest.mark.parametrize(
    ("mean_kg_ha", "said"),
    [(300.0, "-5.9 % = -18 kg/ha"), (120.0, "-5.9 % = -7 kg/ha"), (None, "-5.9 %   ")],
)
def test_what_a_cause_costs_is_its_share_of_the_logs_own_rate(
    cause_of: Callable[..., Cause],
    found_of: Callable[..., Diagnosis],
    mean_kg_ha: float | None,
    said: str,
) -> None:
    view = found_of_page(found_of(cause_of("flow.fill_falloff")), mean_kg_ha)
    assert panel_views.make_causes_view(view, 0, METRIC).causes[0].cost.startswith(said)
