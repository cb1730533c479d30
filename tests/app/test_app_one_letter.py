"""One letter, one meaning, over all pages and questions; what has no letter stands in the
page's menu."""

from __future__ import annotations

import re

import pytest
from topdress.console import app as console_app
from topdress.console.app import actions

from tests.app.harness import looked, turned

# The letters that stand for one thing done to several: what they do, and the words of the pages
# for it. Ten letters are left where the Run page and the keys of every page have theirs; what
# is not of such a kind stands in the page's menu.
KINDS = {
    "b": (
        "begins what is measured by driving; again: ends it",
        {"boundary", "N strip", "begin / end"},
    ),
    "c": ("connects", {"connect", "connect / disconnect"}),
    "e": ("writes a new file", {"export", "report", "write raw", "save as new"}),
    "j": ("takes a file", {"job", "open", "other data", "file", "bench table"}),
    "p": ("the map of planned rates", {"prescription", "plan"}),
    "v": (
        "what is shown: the next of it, another, all of it",
        {"colours", "channels", "next view", "details"},
    ),
    "y": ("moves on, or stands still", {"play / pause", "freeze", "follow"}),
    "z": ("the whole", {"whole field", "whole run"}),
}
# Two meanings, and why: a dose and a picture. Everybody looks nearer by +; the dose asks first.
TWO = {"+": {"more", "nearer", "shorter"}, "-": {"less", "farther", "longer"}}
SAFETY = {"r": "ready", "s": "start", "x": "STOP", "h": "allow", "space": "hold"}

STATES = (("off", ">R make ready"), ("ready", ">S start to work"), ("working", "(S start to work)"))


def printed(action):
    """Keys that a finger can strike by mistake for a word: letters, signs, and Space."""
    return {
        key
        for key in actions.find_keys(action, {})
        if re.fullmatch(
            "[a-z]|space|comma|full_stop|slash|semicolon|"
            "left_square_bracket|right_square_bracket|apostrophe|exclamation_mark",
            key,
        )
    }


def labels_by_key():
    found = {}
    for one in actions.ACTIONS:
        for key in printed(one):
            found.setdefault(key, set()).add(one.label)
    return found


def test_a_letter_means_one_thing_on_all_pages():
    two = {
        key: sorted(labels)
        for key, labels in labels_by_key().items()
        if len(labels) > 1 and not labels <= KINDS.get(key, ("", set()))[1]
    }
    assert two == {}


def test_nothing_stands_in_the_list_of_kinds_that_no_page_has():
    labels = labels_by_key()
    assert {
        key: words - labels[key] for key, (_what, words) in KINDS.items() if words - labels[key]
    } == {}


def test_the_signs_with_two_meanings_are_these():
    for sign, key in (("+", "plus"), ("-", "minus")):
        assert {one.label for one in actions.ACTIONS if key in actions.find_keys(one, {})} == TWO[
            sign
        ]


def test_the_keys_of_safety_mean_the_same_or_nothing():
    labels = labels_by_key()
    assert {key: labels[key] for key in SAFETY} == {key: {word} for key, word in SAFETY.items()}


def test_no_question_has_a_letter_of_its_own():
    """In a dialog a letter does nothing: what is chosen there has digits, arrows, Enter and Esc."""
    import importlib
    import pkgutil

    from textual.screen import Screen
    from topdress.console.app.pages.base_page import Page

    for module in pkgutil.walk_packages(console_app.__path__, "topdress.console.app."):
        importlib.import_module(module.name)
    kinds, found = [Screen], {}
    while kinds:
        kind = kinds.pop()
        kinds += kind.__subclasses__()
        if kind.__module__.startswith("topdress.console.") and not issubclass(kind, Page):
            for one in kind.__dict__.get("BINDINGS", ()):
                keys = [key for key in one.key.split(",") if re.fullmatch("[a-z]", key)]
                if keys:
                    found.setdefault(kind.__name__, []).extend(keys)
    assert found == {}


def test_a_menu_counts_from_one_and_has_no_more_lines_than_digits():
    for where in {one.where for one in actions.ACTIONS}:
        assert [one.keys for one in actions.list_menu_actions(where)] == [
            f"q_{at + 1}" for at in range(len(actions.list_menu_actions(where)))
        ]
        assert len(actions.list_menu_actions(where)) <= 9
        assert not [one.id for one in actions.list_menu_actions(where) if one.bar], (
            "the bar has the menu itself"
        )


TOKEN = re.compile(r"(?<![A-Za-z0-9^'+./_{-])([A-Z]|Q\d|Del)(?![A-Za-z0-9'+_}/-])")
NO_KEY = (
    r"\bA [a-z]",
    r"sets B\b",
    r"Sets A, then B",
    "A is here",
    "B is too near to A",
    "% N",
    "share of N",
    # an article, ends of a line, nitrogen, volts
    "N strip",
    "N used",
    "per V",
    "supply, V",
)


def catalogue():
    from pathlib import Path

    from topdress.console.locale import po_reader

    for path in sorted((Path(po_reader.__file__).parent / "zh").glob("*.po")):
        yield from po_reader.read_po(path.read_text(encoding="utf-8"), path.name).items()


def keys_named(text):
    for pattern in NO_KEY:
        text = re.sub(pattern, "", text)
    return sorted(TOKEN.findall(text))


def test_both_languages_name_the_same_keys():
    other = {
        english: chinese
        for english, chinese in catalogue()
        if keys_named(english) and not set(keys_named(english)) <= set(TOKEN.findall(chinese))
    }
    assert other == {}


def test_a_key_that_a_text_names_is_a_key():
    shown = {actions.find_shown_key(one) for one in actions.ACTIONS}
    assert {text for text, _chinese in catalogue() if not set(keys_named(text)) <= shown} == set()


@pytest.mark.exam
async def test_the_menu_lists_what_has_no_letter(picture, shown):
    for size in ((120, 40), (80, 24), (60, 20)):
        app = picture(size=size, screen="job")
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await turned(app, pilot, "job")
            assert size[0] < 80 or "Q menu" in shown(app)[-1], (size, shown(app)[-1])
            await pilot.press("Q")  # Caps Lock
            await pilot.pause()
            rows = "\n".join(shown(app))
            assert all(
                f"{number}  {word}" in rows
                for number, word in enumerate(("crop", "machine", "whose", "report"), 1)
            ), (size, rows)
            await pilot.press("1", "enter")
            await pilot.pause(0.2)
            assert "Crop" in "\n".join(shown(app)), size


def test_what_a_chip_shows_is_the_key_that_does_it():
    """The rows of keys on the pages repeat the keys of the table."""
    from pathlib import Path

    for path in Path(console_app.__file__).parent.rglob("*.py"):
        for name, shown in re.findall(
            r'Chip\("(\w+)", "([^"]+)"', path.read_text(encoding="utf-8")
        ):
            assert actions.find_shown_key(actions.BY_ID[name]) == shown, (path.name, name)


async def test_ready_and_start_stand_on_the_job_page_where_the_list_ends(picture, shown):
    from dataclasses import replace

    from topdress.console.app.dialogs import Confirm
    from topdress.control.orders import Do

    for size in ((120, 40), (80, 24)):
        app = picture(size=size, screen="job")
        async with app.run_test(size=size) as pilot:
            await turned(app, pilot, "job")
            for state, row in STATES:
                frame = app.source.current_frame
                app.source.current_frame = replace(
                    frame, seq=frame.seq + 1, row=frame.row._replace(state=state)
                )
                await looked(app, pilot)
                assert any(row in one for one in shown(app)), (size, state)
            frame = app.source.current_frame
            app.source.current_frame = replace(
                frame, seq=frame.seq + 1, row=frame.row._replace(state="off")
            )
            app.show_newest()
            await pilot.press("r")
            assert [one.do for one in app.source.orders] == [Do.READY]
            app.source.current_frame = replace(
                app.source.current_frame, seq=frame.seq + 2, row=frame.row._replace(state="ready")
            )
            app.show_newest()
            await pilot.press("s")
            assert isinstance(app.screen, Confirm)
