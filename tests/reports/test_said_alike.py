"""The same facts of a diagnosis on terminal, report, Diagnosis page and in JSON; in both languages."""
from __future__ import annotations

import html
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from console.app.pages.diagnosis import shown
from console.app.units import METRIC
from console.locale import ENGLISH, use
from console.reports.diagnosis_html import diagnosis_page
from console.reports.diagnosis_text import summary
from console.reports.said import headlined, sentence, when
from console.services.diagnosis_view import found_of
from control.diagnosis.result import UNKNOWN, Cause, Channel, Diagnosis, Rival, Size, Unexplained
from control.machine.machine import CATALOGUE, Machine

CHANNELS = tuple(Channel(name, unit, 2000, 0.0, 0.4, 0.1, 0.9, 0.5) for name, unit in (
    ("shaft", "r/min"), ("gate", "mm"), ("flow", "kg/s"), ("scale", "kg"), ("speed", "m/s"), ("heads", "NDVI")))
LEFT_OUT = "stage gate is left out: column opening_mm_cmd is missing or nearly empty"
GATE = Size(0.8, 0.6, 1.0, "mm")


@pytest.fixture(autouse=True)
def english() -> Iterator[None]:
    use(ENGLISH)
    yield
    use(ENGLISH)


def spoken(found: Diagnosis) -> dict[str, str]:
    """What each of them says, in one line of words."""
    text = diagnosis_page(found, {"machine": Machine()})
    on_page = found_of(found, {"machine": Machine()}, "run.csv", None)
    said, causes, channels = shown.said(on_page, ""), shown.causes(on_page, 0, METRIC), shown.channels(on_page)
    lines = [said.word, said.sentence, said.todo, *(words for one in causes.causes for words in one if
                                                   isinstance(words, str)), *causes.calm, *channels.left]
    return {"terminal": _flat("\n".join(summary(found))),
            "report": _flat(html.unescape(re.sub(r"<[^>]*>", " ", text[text.index("<body>"):]))),
            "page": _flat("\n".join(lines))}


def _flat(text: str) -> str:
    return " ".join(text.split())


KINDS: dict[str, tuple[dict[str, Any], list[dict[str, Any]], tuple[str, ...], tuple[str, ...]]] = {
    # name: (of the diagnosis, its causes, facts in English, in Chinese)
    "none": ({}, [], (), ()),
    "since": ({}, [{"onset_s": 300.0}], ("since 300 s",), ("从第 300 秒起",)),
    "span": ({}, [{"onset_s": 200.0, "until_s": 320.0}], ("from 200 s to 320 s",), ("从第 200 秒到第 320 秒",)),
    "ended": ({}, [{"until_s": 320.0}], ("until 320 s",), ("到第 320 秒为止",)),
    "grows": ({}, [{"onset_s": 304.0, "grows": True}], ("grows from 304 s on to 0.8 mm at the end",),
              ("从第 304 秒起增大，到结束时为 0.8 mm",)),
    "suspected": ({"verdict": "ambiguous"}, [{"probability": 0.49, "rivals": (Rival(UNKNOWN, 0.5),)}],
                  ("something else", "no cause is likely enough to be named"),
                  ("其他原因", "没有足够可能的原因可以指明")),
    "noise": ({"verdict": "unexplained", "unexplained": (
        Unexplained("gate", "", 0.9, 0.43, 0.1, "mm", 2.5, "gate.offset", 310.0, 56.0),)}, [],
        ("typically off by 0.43 mm; the sensors alone are off by 0.10 mm", "2.5 % of the dose",
         "comes and goes every 56 s",
         "nearest: gate.offset, whose evidence does not hold", "seems to begin at 310 s"),
        ("一般偏差 0.43 mm；仅传感器为 0.10 mm", "占施肥量的 2.5 %", "每 56 秒起伏一次",
         "最接近的是 gate.offset，但其证据不成立", "似从第 310 秒开始")),
    "variable": ({"verdict": "unexplained", "unexplained": (
        Unexplained("shaft", "supply_v", 0.4, 1.2, 0.25, "r/min", -3.0),)}, [],
        ("typically off by 1.20 r/min; the sensors alone are off by 0.25 r/min", "3 % of the dose"),
        ("一般偏差 1.20 r/min；仅传感器为 0.25 r/min", "占施肥量的 3 %")),
    "missing": ({"channels": CHANNELS[:1] + CHANNELS[2:], "findings": (LEFT_OUT,)}, [], (LEFT_OUT,), (LEFT_OUT,)),
    "not judged": ({"verdict": "not_judged", "channels": (), "findings": (LEFT_OUT,)}, [], (LEFT_OUT,), (LEFT_OUT,)),
}


@pytest.fixture
def of_kind(cause_of: Callable[..., Cause], found_of: Callable[..., Diagnosis]) -> Callable[[str], Diagnosis]:
    def made(kind: str) -> Diagnosis:
        of_all, causes, _english, _chinese = KINDS[kind]
        return found_of(*(cause_of("gate.offset", **{"size": GATE, **one}) for one in causes),
                        **{"channels": CHANNELS, **of_all})
    return made


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_facts_everywhere(kind: str, of_kind: Callable[[str], Diagnosis]) -> None:
    for where, said in spoken(of_kind(kind)).items():
        assert [fact for fact in KINDS[kind][2] if fact.lower() not in said.lower() and not (
            where == "terminal" and fact.startswith("no cause"))] == [], where
        others = {fact for one in KINDS.values() for fact in one[2]} - set(KINDS[kind][2])
        assert [fact for fact in others if fact in said] == [], where


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_facts_in_chinese(kind: str, of_kind: Callable[[str], Diagnosis]) -> None:
    use("zh")
    said = spoken(of_kind(kind))["page"]
    assert [fact for fact in KINDS[kind][3] if fact not in said] == []


@pytest.mark.parametrize("kind", KINDS)
def test_json_holds_every_field_that_is_said(kind: str, of_kind: Callable[[str], Diagnosis]) -> None:
    found = of_kind(kind)
    data = json.loads(json.dumps(found.to_json()))
    assert [Unexplained(**one) for one in data["unexplained"]] == list(found.unexplained)
    assert [(one["onset_s"], one["until_s"], one["grows"], [rival["id"] for rival in one["rivals"]])
            for one in data["causes"]] == [(one.onset_s, one.until_s, one.grows, [rival.id for rival in one.rivals])
                                           for one in found.causes]


@pytest.mark.parametrize("kind", ["missing", "not judged"])
def test_what_was_not_judged_comes_before_all_else(kind: str, of_kind: Callable[[str], Diagnosis],
                                                   cause_of: Callable[..., Cause]) -> None:
    found = of_kind(kind)
    found = replace(found, causes=(cause_of("flow.gain"),), verdict="named" if kind == "missing" else "not_judged")
    said = spoken(found)
    for where in ("terminal", "report"):
        assert said[where].index(LEFT_OUT) < said[where].index(found.causes[0].advice)
    lines = summary(found)
    missing = "gate" if kind == "missing" else "shaft, gate, flow, scale, speed, heads"
    assert lines[1:3] == [f"not judged: {missing}", f"note: {LEFT_OUT}"]
    on_page = found_of(found, {"machine": Machine()}, "run.csv", None)
    assert shown.channels(on_page).left[0] == LEFT_OUT
    if kind == "missing":
        assert shown.said(on_page, "").sentence.startswith("Not judged: gate. ")
        assert sentence(found).startswith("Not judged: gate. ")


def test_a_cause_less_likely_than_not_is_in_no_headline(cause_of: Callable[..., Cause],
                                                       found_of: Callable[..., Diagnosis]) -> None:
    weak = cause_of("gate.offset", size=GATE, probability=0.49, rivals=(Rival(UNKNOWN, 0.5),))
    even = replace(weak, probability=0.5)
    strong = cause_of("shaft.voltage_sag", probability=0.9)
    assert [headlined(one) for one in (weak, replace(weak, rivals=()), even, strong)] == [False, False, False, True]
    found = found_of(weak, strong, verdict="ambiguous", channels=CHANNELS)
    titles = [CATALOGUE[one.id].effect.title for one in (strong, weak)]
    on_page = found_of_page(found)
    for head in (sentence(found), shown.said(on_page, "").sentence):
        assert titles[0].lower() in head.lower() and titles[1].lower() not in head.lower()
        assert "suspected" in head
    for said in spoken(found).values():
        assert said.lower().index(titles[0].lower()) < said.lower().index(titles[1].lower())
        assert re.search(r"suspected: (gate.offset: )?" + re.escape(titles[1].lower()), said.lower())
    alone = found_of_page(replace(found, causes=(weak,)))
    assert CATALOGUE[weak.id].effect.advice != shown.said(alone, "").todo


def found_of_page(found: Diagnosis, mean_target_kg_ha: float | None = None) -> Any:
    return found_of(found, {"machine": Machine()}, "run.csv", mean_target_kg_ha)


def test_a_size_that_grows_is_said_with_its_sign_and_without_needless_zeros(cause_of: Callable[..., Cause]) -> None:
    grown = cause_of("gate.offset", size=Size(-12.0, None, None, "%"), onset_s=304.0, grows=True)
    assert when(grown) == "grows from 304 s on to -12 % at the end"
    assert when(replace(grown, size=Size(None, None, None, "%"))) == "grows from 304 s on to its size at the end"
    assert when(replace(grown, onset_s=None, grows=False)) == ""


@pytest.mark.parametrize(("mean_kg_ha", "said"), [
    (300.0, "-5.9 % = -18 kg/ha"), (120.0, "-5.9 % = -7 kg/ha"), (None, "-5.9 %   ")])
def test_what_a_cause_costs_is_its_share_of_the_logs_own_rate(cause_of: Callable[..., Cause],
                                                              found_of: Callable[..., Diagnosis],
                                                              mean_kg_ha: float | None, said: str) -> None:
    view = found_of_page(found_of(cause_of("flow.fill_falloff")), mean_kg_ha)
    assert shown.causes(view, 0, METRIC).causes[0].cost.startswith(said)
