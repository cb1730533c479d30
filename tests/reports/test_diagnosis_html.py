"""The page: everything in it, nothing fetched by it, hostile words harmless."""
from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import replace
from html import escape, unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import console
from console.reports import html
from console.reports.diagnosis_html import diagnosis_page
from console.reports.fleet_page import fleet_page
from console.reports.paper_page import paper_page
from console.reports.run_pictures import cause_pictures
from console.reports.run_views import View, parts_of, run_views
from console.reports.said import cost, sentence
from control.calibration.bench_table import BenchTable
from control.diagnosis.result import Cause, Diagnosis, FieldCost, NotShown, TableFit, Unexplained
from control.diagnosis.season.courses import SeasonFit
from control.machine.machine import CATALOGUE, Machine
from tests.command import topdress

OF_RUNS = [i for i, e in CATALOGUE.items() if "run" in " ".join(e.effect.seen_in)]
EMPTY = frozenset({"meta", "line", "circle", "rect", "br", "path", "use"})
HOSTILE = '<script>alert("1")</script>&\'$x_1$.csv'
OF_TABLES = {"lag": ("lag.offset", "lag.rebound", "lag.coarse_clock", "shaft.dead_time", "lag.speed_scale"),
             "catch": ("flow.gain", "flow.fill_falloff", "flow.zero_offset"), "weigh": ("flow.gain", "scale.gain"),
             "heads": ("canopy.head_fouled", "canopy.saturation"), "place": ("place.lever_arm", "place.latency")}


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
    assert not set(read.tags) & {"script", "link", "iframe", "object", "embed", "img", "image", "base", "form",
                                 "metadata"}
    assert all(address.startswith("#") for address in read.addresses)
    assert {address[1:] for address in read.addresses} <= set(read.ids)
    assert len(read.ids) == len(set(read.ids))
    assert all(where.startswith("#") for where in re.findall(r"url\(([^)]*)\)", text))
    assert "@import" not in text and "http:" not in text and "https:" not in text
    assert not re.search(r"\son\w+=", text)
    return read


def test_page_holds_everything(full: Diagnosis, run_columns: dict[str, Any], machine: Machine) -> None:
    text = diagnosis_page(full, {"columns": run_columns, "machine": machine, "date": "2026-05-01", "sha256": "ab12",
                       "version": "9.9"})
    read = harmless(text)
    said = read.said()
    for cause in full.causes:
        entry = CATALOGUE[cause.id].effect
        for words in (cause.id, entry.title, entry.physics, cause.advice):
            assert words in said
    for words in ("Not told apart".lower(), "shaft.load_droop", "21 %", "shaft.dead_band", "7 %", "4.0 to 6.0",
                  "head 3", "since 130 s", "5.9 % too little is spread", "0.25 m beyond its place",
                  "Stairs, twice", "Refill by bags", "0.2868", "0.2830 to 0.2910", "blocks 2, 5, 7 of 8", "-9999",
                  "0.27 %", "gate.stuck", "ab12", "9.9", "2026-05-01", "huanghai"):
        assert words in said, words
    assert said.index("shaft.voltage_sag") < said.index("canopy.head_fouled") < said.index("flow.blocked_outlet")
    assert text.count("<figure>") == 4
    assert text.count("onset") >= 1


def test_the_same_page_twice(bench_tables: dict[str, BenchTable], machine: Machine, cause_of: Callable[..., Cause],
                             found_of: Callable[..., Diagnosis]) -> None:
    tools = {"tables": [bench_tables["weigh"]], "machine": machine}
    found = found_of(cause_of("flow.gain"), kind="weigh")
    assert diagnosis_page(found, tools) == diagnosis_page(found, tools)


@pytest.mark.parametrize("kind", OF_TABLES)
def test_each_kind_of_table(kind: str, bench_tables: dict[str, BenchTable], machine: Machine,
                            cause_of: Callable[..., Cause], found_of: Callable[..., Diagnosis]) -> None:
    causes = [cause_of(effect_id) for effect_id in OF_TABLES[kind]]
    left = (Unexplained("place" if kind == "place" else "lag" if kind == "lag" else "heads" if kind == "heads"
                        else "flow", "target_kg" if kind == "weigh" else "ndvi_reference" if kind == "heads"
                        else "shaft_rpm", 0.4),)
    text = diagnosis_page(found_of(*causes, kind=kind, unexplained=left),
                          {"tables": [bench_tables[kind]], "machine": machine})
    said = harmless(text).said()
    assert all(cause.id in said for cause in causes)
    assert text.count("<figure>") == 2 + ("lag.coarse_clock" in OF_TABLES[kind])


def test_two_tables_and_nothing_found(bench_tables: dict[str, BenchTable], machine: Machine,
                                      found_of: Callable[..., Diagnosis]) -> None:
    found = found_of(kind="lag+place")
    text = diagnosis_page(found, {"tables": [bench_tables["lag"], bench_tables["place"]], "machine": machine})
    said = harmless(text).said()
    assert "Everything is as the machine file says" in said and "lag and place table" in said
    assert text.count("<figure>") == 2
    assert "What was found" not in said and "with the causes" not in said


@pytest.fixture(scope="module")
def views(run_columns: dict[str, Any], machine: Machine) -> tuple[View, ...]:
    return run_views(run_columns, machine)


@pytest.mark.parametrize("effect_id", [
    one if number % 3 == 0 else pytest.param(one, marks=pytest.mark.exam) for number, one in enumerate(OF_RUNS)])
def test_every_effect_of_a_run_has_its_picture(effect_id: str, views: tuple[View, ...],
                                               cause_of: Callable[..., Cause]) -> None:
    part = parts_of([cause_of(effect_id)])[0]
    pictures = cause_pictures(views, [part], part, "one")
    # This log has no refill, nothing turns backwards in it, all heads warm up alike, and no drive tells its effort.
    if effect_id in ("flow.batch", "shaft.back_gain", "shaft.back_zone", "canopy.warm_up") or "effort." in effect_id:
        return
    assert len(pictures) == 1
    read = harmless(pictures[0].svg)
    assert "nominal machine" in read.said() and "with the causes" in read.said()
    assert "NaN" not in pictures[0].svg and "nan" not in re.findall(r'[ "](nan)[ ,"]', pictures[0].svg)


def test_unexplained_shows_the_smooth_function(run_columns: dict[str, Any], machine: Machine,
                                               found_of: Callable[..., Diagnosis]) -> None:
    nodes = tuple(np.linspace(12.3, 13.7, 8).tolist())
    fit = TableFit("shaft", "supply_v", nodes, tuple(5.0 * (x - 13.5) for x in nodes))  # type: ignore[arg-type]
    found = found_of(verdict="unexplained", unexplained=(Unexplained("shaft", "supply_v", 0.9),), tables=(fit,))
    said = harmless(diagnosis_page(found, {"columns": run_columns, "machine": machine})).said()
    for words in ("shaft changes with supply (supply_v)", "90 %", "smooth function", "shaft more than nominal, %"):
        assert words in said


def test_hostile_words_stay_words(full: Diagnosis, bench_tables: dict[str, BenchTable], machine: Machine,
                                  cause_of: Callable[..., Cause], found_of: Callable[..., Diagnosis]) -> None:
    lag = bench_tables["lag"]
    label = np.array([HOSTILE, "中文 label"] * 6)
    found = found_of(cause_of("lag.offset", advice=HOSTILE), kind="lag", findings=(HOSTILE,), extended_machine=HOSTILE,
                     not_shown=(NotShown(HOSTILE, full.not_shown[0].smallest_detectable),))
    found = replace(found, data=replace(found.data, path=HOSTILE, machine=HOSTILE))
    text = diagnosis_page(found, {"tables": [replace(lag, path=HOSTILE, label=label, label_column=HOSTILE)],
                                  "machine": machine,
                        "date": HOSTILE, "version": HOSTILE, "sha256": HOSTILE})
    said = harmless(text).said()
    assert "<script" not in text
    assert said.count(HOSTILE) >= 9
    assert escape(HOSTILE) in text and unescape(escape(HOSTILE)) == HOSTILE
    drawn = text[text.index("<svg class=\"picture\""):text.index("</svg>", text.index("<svg class=\"picture\""))]
    assert HOSTILE in Reader(drawn).said() and "中文" in Reader(drawn).said()


def test_checksum_is_of_the_file(tmp_path: Path, bench_tables: dict[str, BenchTable], machine: Machine,
                                 found_of: Callable[..., Diagnosis]) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(b"abc")
    found = found_of(kind="lag")
    found = replace(found, data=replace(found.data, path=str(path)))
    text = diagnosis_page(found, {"tables": [bench_tables["lag"]], "machine": machine})
    assert "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad" in text
    assert "sha256" not in diagnosis_page(found_of(kind="lag"), {"tables": [bench_tables["lag"]], "machine": machine})


def test_without_matplotlib_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch,
                                                          found_of: Callable[..., Diagnosis]) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ValueError, match=r"^a report needs the extra report, not installed: .* 'matplotlib>=[\d.]+'$"):
        diagnosis_page(found_of(), {})


def test_sentences(cause_of: Callable[..., Cause], found_of: Callable[..., Diagnosis], full: Diagnosis) -> None:
    assert sentence(found_of()).startswith("Everything is as the machine file says")
    assert sentence(found_of(cause_of("flow.gain"))) == "Kilograms per revolution off by a factor."
    assert sentence(full).startswith("Test next: Stairs, twice (10 min). It tells apart: Shaft loses speed when ")
    assert cost(FieldCost(None, None)) == "not known"
    assert cost(FieldCost(0.0, 0.0)) == "nothing in dose or place"
    assert cost(FieldCost(2.04, -0.3)) == "2.0 % too much is spread; material lands 0.30 m short of its place"


def test_each_of_two_causes_has_a_picture_of_its_own(views: tuple[View, ...], cause_of: Callable[..., Cause]) -> None:
    """What each takes away from what the other leaves: both on one axis, they were one picture twice."""
    parts = parts_of([cause_of("shaft.gain"), cause_of("shaft.voltage_sag")])
    one, other = (cause_pictures(views, parts, part, "same")[0] for part in parts)
    assert one.svg != other.svg
    for picture in (one, other):
        said = harmless(picture.svg).said()
        assert "with the other causes" in said and "nominal machine" not in said


def test_a_log_of_one_command_has_a_report(tmp_path: Path) -> None:
    """Nothing in it moves but time."""
    rng, log = np.random.default_rng(1), tmp_path / "held-log.csv"
    log.write_text("time_s,shaft_rpm_cmd,shaft_rpm\n" + "".join(
        f"{0.1 * k:.1f},900,{860 + 5 * rng.standard_normal():.2f}\n" for k in range(600)))
    machine, out = tmp_path / "m.yaml", tmp_path / "r.html"
    machine.write_text("format: topdress-machine/1\nid: held\nstages: [shaft]\nshaft: {full_rpm: 1000, "
                       "acceleration_rpm_s: 1.0e+6, dead_time_s: 0, time_constant_s: 0.05}\n"
                       "limits: {shaft_low_rpm: 0, shaft_high_rpm: 1000}\nnoise: {shaft_rpm: 5}\n")
    done = topdress("diagnose", log, "--machine", machine, "--report", out)
    assert done.exit_code in (0, 1) and out.exists(), done.output
    assert "shaft" in harmless(out.read_text(encoding="utf-8")).said()


def test_command_writes_the_report(tmp_path: Path) -> None:
    data, out = tmp_path / "a <b>.csv", tmp_path / "r.html"
    rows = [f"{rpm},{2.2118 - 0.0083 * rpm + 0.4 + 0.01 * ((3 * k) % 5 - 2):.3f}"
            for k, rpm in enumerate(range(10, 71, 5))]
    data.write_text("shaft_rpm,lag_s\n" + "\n".join(rows) + "\n")
    result = topdress("diagnose", data, "--report", out)
    assert result.exit_code == 0, result.output
    said = harmless(out.read_text(encoding="utf-8")).said()
    assert "lag.offset" in said and "a <b>.csv" in said


# --- One head for all pages of reports: nothing is fetched or run, whoever wrote the words in them -------------------

SOURCES = sorted(Path(console.__file__).parent.rglob("*.py"))


def test_every_page_may_fetch_nothing() -> None:
    for text in (html.page("<script>", "p {}", "<p>said</p>"), paper_page([], "topdress"),
                 fleet_page([], SeasonFit(), low=[], units={}, broken=(), price=None, currency="CNY",
                            software="topdress")):
        head = text.partition("</head>")[0].lower()
        assert "default-src 'none'" in head and head.index("content-security-policy") < head.index("<title>")
        assert "<script>" not in text


def test_no_report_has_a_head_of_its_own() -> None:
    heads = [path.name for path in SOURCES if "<!doctype" in path.read_text(encoding="utf-8").lower()]
    assert heads == ["html.py"]


def test_pictures_that_stand_in_a_page_are_shown() -> None:
    """The scale of colours beside a map is a picture in the page itself."""
    policy = html.page("", "", "").partition("Content-Security-Policy")[2].partition(">")[0]
    assert "img-src data:" in policy and "http" not in policy and "*" not in policy
