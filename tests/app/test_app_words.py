"""Every shown text has its Chinese, every format keeps its values, and nothing of ambiguous
width stands in a row."""

from __future__ import annotations

import ast
import re
import string
import unicodedata
from pathlib import Path

import pytest
from topdress.console import app as console_app
from topdress.console.app import frame_words
from topdress.console.app.pages.job.checklist import translate_crop_note
from topdress.console.locale import (
    N_,
    _,
    find_language_code,
    find_preferred_language,
    list_languages,
    read_catalogue,
    use_language,
)
from topdress.console.locale.po_reader import read_po
from topdress.control.machine.term_form import FORMS
from topdress.control.orders import Alarm, Severity, State, Strategy, TargetSource
from topdress.control.safety import ALARMS, INTERLOCKS, REFUSALS
from topdress.drivers.files.config import find_shipped_files, load_config
from topdress.drivers.files.config_kinds import CROP_KIND

from tests.app.gallery import Picture, settle, still_app

APP = Path(console_app.__file__).parent


def marked() -> dict[str, str]:
    """Every text in `_()` or `N_()` of the app and of the words that it shares with reports,
    with its file."""
    texts = {}
    sources = [*APP.rglob("*.py"), *(APP.parent / "reports").rglob("*.py")]
    rooms = APP.parents[1]
    sources += [rooms / "control" / "signals.py", *(rooms / "drivers" / "devices").glob("*.py")]
    for path in sorted(sources):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name)
                and node.func.id in ("_", "N_")
            ):
                argument = node.args[0]
                if isinstance(argument, ast.Constant):
                    texts[argument.value] = path.name
    return texts


REFUSALS_BY = {
    "Reason": 0,
    "at": 0,
    "NoGridError": 0,
    "RefusedInput": 1,
    "BeyondLimits": 1,
    "ArchiveError": 1,
    "ShapesError": 1,
    "PrescriptionError": 1,
    "NotAMapError": 1,
    "NoPolygonsError": 1,
    "RateQuestion": 1,
    "_choose_error_class": 1,
}


def refused() -> dict[str, str]:
    """Every text with which a reader of files refuses a prescription, with its file: the call's
    first text."""
    texts = {}
    for path in sorted((APP.parents[1] / "drivers" / "files").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                made = {
                    one.id if isinstance(one, ast.Name) else getattr(one, "attr", "")
                    for one in ast.walk(node.func)
                    if isinstance(one, ast.Name | ast.Attribute)
                }
                for argument in (
                    node.args[REFUSALS_BY[name] :][:1] for name in made & set(REFUSALS_BY)
                ):
                    texts |= dict.fromkeys(
                        (
                            one.value
                            for part in argument
                            for one in ast.walk(part)
                            if isinstance(one, ast.Constant) and isinstance(one.value, str)
                        ),
                        path.name,
                    )
    return {
        text: where
        for text, where in texts.items()
        if re.search("[a-z]", re.sub(r"{[^}]*}", "", text))
    }


def all_texts() -> dict[str, str]:
    texts = marked() | refused() | dict.fromkeys(frame_words.STRATEGY_NAMES.values(), "words.py")
    for kind in ALARMS.values():
        texts |= dict.fromkeys((kind.text, kind.todo, kind.place), "alarms")
    for form in FORMS.values():
        texts |= dict.fromkeys(form.sentences, "forms")
    return (
        texts
        | dict.fromkeys(REFUSALS.values(), "refusals")
        | dict.fromkeys(crop_notes(), "crop notes")
    )


def crop_notes() -> set[str]:
    """What the shipped crops note about themselves, the names of keys left out."""
    notes = {
        note
        for place in find_shipped_files(CROP_KIND.folder).values()
        for note in load_config(place, CROP_KIND).model.warnings
    }
    return {
        note.partition(": ")[0] if note.startswith("example values") else note for note in notes
    }


def fields(text: str) -> set[str]:
    return {name for _literal, name, _spec, _conversion in string.Formatter().parse(text) if name}


@pytest.mark.parametrize("language", [code for code in list_languages() if code != "en"])
def test_every_text_is_translated_and_keeps_its_values(language):
    known = read_catalogue(language).texts
    missing = {text: where for text, where in all_texts().items() if not known.get(text)}
    assert not missing
    assert {text for text in all_texts() if fields(text) != fields(known[text])} == set()


def test_the_refusals_of_a_prescription_are_found():
    """Of each reader at least one: a new way of refusing may not slip by the test above."""
    assert {
        "map_choices.py",
        "features.py",
        "csv_zones.py",
        "grid_from_points.py",
        "raster.py",
        "shape_layers.py",
        "isoxml_read.py",
        "task_files.py",
        "shapes.py",
        "limits.py",
        "archives.py",
    } <= set(refused().values())


def test_every_word_of_the_shared_vocabulary_is_known():
    assert (
        set(frame_words.STATE_NAMES)
        == set(frame_words.STATE_SYMBOLS)
        == {state.value for state in State}
    )
    assert set(frame_words.STRATEGY_NAMES) == {strategy.value for strategy in Strategy}
    assert set(frame_words.SOURCE_NAMES) == {source.value for source in TargetSource}
    assert set(INTERLOCKS) <= set(frame_words.NOTE_NAMES)
    assert set(REFUSALS) <= set(frame_words.ANSWER_TEXTS)


LATIN_ALLOWED = re.compile(
    r"kg/ha|km/h|r/min|mm|kg|ha|km|GNSS|NDVI|RTK|Hz|m|s|x|run\.csv|huanghai|winter "
    r"wheat|demonstration|Space|Home|End"
    r"|PgUp|PgDn|Esc|Tab|F\d+|[A-Z]"
)


@pytest.mark.parametrize(
    ("screen", "alarms"),
    [("run", True), ("replay", False), ("gone", False), ("map", True), ("trends-read", False)],
)
async def test_no_english_word_is_left_on_a_chinese_screen(shown, screen, alarms):
    picture = Picture("zh", (120, 40), language="zh", screen=screen, alarms=alarms)
    app, _clock = still_app(picture)
    async with app.run_test(size=picture.size) as pilot:
        await settle(app, picture, pilot.pause)
        text = "\n".join(shown(app)).replace("the connection to the machine broke off", "")
        text = re.sub(r"(?<=[┃┛┓])\w+", "", text)  # a word that the dialog's edge cuts
        left = [
            word
            for word in re.findall(r"[A-Za-z/.]*[A-Za-z][A-Za-z/.]*", LATIN_ALLOWED.sub(" ", text))
        ]
        assert left == []


# box drawing and blocks: bars, numerals, map; never beside text in a column
DRAWN = range(0x2500, 0x25A0)


@pytest.mark.parametrize("screen", ["run", "replay", "help", "map", "trends-read"])
async def test_no_text_holds_a_character_of_ambiguous_width(shown, screen):
    picture = Picture("en", (120, 40), screen=screen, alarms=screen == "run")
    app, _clock = still_app(picture)
    async with app.run_test(size=picture.size) as pilot:
        await settle(app, picture, pilot.pause)
        text = "".join(shown(app))
        assert {
            c for c in text if unicodedata.east_asian_width(c) == "A" and ord(c) not in DRAWN
        } == set()


def test_no_symbol_or_text_of_the_tables_is_of_ambiguous_width():
    texts = [
        *frame_words.STATE_SYMBOLS.values(),
        *frame_words.SEVERITY_SYMBOLS.values(),
        *all_texts(),
    ]
    assert {c for text in texts for c in text if unicodedata.east_asian_width(c) == "A"} == set()


def test_languages_are_used_and_refused_in_one_line():
    use_language("zh")
    assert find_language_code() == "zh" and _("hold") != "hold" and N_("hold") == "hold"
    assert _("not in the catalogue") == "not in the catalogue" and _("") == ""
    allowed = ", ".join(list_languages())
    with pytest.raises(ValueError, match=f"language: 'xx' is not known; allowed: {allowed}"):
        use_language("xx")
    assert find_language_code() == "zh"


@pytest.mark.parametrize(
    ("environment", "code"),
    [
        ({"LANG": "zh_CN.UTF-8"}, "zh"),
        ({"LANG": "C.UTF-8"}, "en"),
        ({}, "en"),
        ({"LC_ALL": "en_GB.UTF-8", "LANG": "zh_CN.UTF-8"}, "en"),
    ],
)
def test_the_environment_chooses_the_language(environment, code):
    assert find_preferred_language(environment) == code


def test_po_continued_lines_comments_and_fuzzy_entries():
    text = (
        '# note\nmsgid ""\nmsgstr "Language: zh\\n"\n\nmsgid "a"\n"b"\nmsgstr "x"\n"y"\n'
        '#, fuzzy\nmsgid "c"\nmsgstr "z"\n'
    )
    assert read_po(text) == {"ab": "xy"}


@pytest.mark.parametrize("line", ['msgctxt "menu"', "msgid unquoted", "nonsense"])
def test_a_po_line_that_cannot_be_read_is_named(line):
    with pytest.raises(ValueError, match=r"zh\.po, line 1: "):
        read_po(line, "zh.po")


def test_a_refusal_names_the_alarm_in_words():
    assert frame_words.describe_refusal("acknowledge_first;alarm=shaft_silent") == (
        "Acknowledge the alarm The metering shaft does not answer first."
    )
    assert frame_words.describe_refusal("") == "not accepted"
    assert frame_words.describe_refusal("internal_error: x") == "internal_error: x"


def test_a_missing_detail_leaves_its_braces():
    assert (
        frame_words.describe_alarm(Alarm("hopper_empty", Severity.RED, 0.0)).text
        == "The hopper is empty (-- kg)."
    )


def test_notes_of_crops_are_told_in_the_language_in_use():
    use_language("zh")
    try:
        assert translate_crop_note("example values, not of this field: days, ndvi_nrich").endswith(
            ": days, ndvi_nrich"
        )
        assert not any(note in translate_crop_note(note) for note in crop_notes())
        assert (
            translate_crop_note("written by a grower: sandy soil")
            == "written by a grower: sandy soil"
        )
    finally:
        use_language("en")
