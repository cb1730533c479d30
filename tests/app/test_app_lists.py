"""Lists of every dialog: digits mark and Enter takes, two digits are one number, and a long
list scrolls."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from textual.widgets import Button
from topdress.console import app as console_app
from topdress.console.app.dialogs import Choice, ChoiceDialog, Confirm
from topdress.console.app.type_ahead_guard import MAX_TYPING_PAUSE_S
from topdress.console.app.widgets.choice_list import ChoiceList
from topdress.console.services.job import JobFiles
from topdress.console.services.launcher import Launcher
from topdress.console.services.removable_media import list_entries
from topdress.control.orders import Do, Order

from tests.app.harness import settled

SIZES = ((120, 40), (80, 24), (60, 20))


def names(count: int) -> list[Choice]:
    return [Choice(f"value {k}", f"line {k}") for k in range(1, count + 1)]


async def asked(app, pilot, choices, now=""):
    answers = []
    dialog = ChoiceDialog("Which?", choices, now)
    app.push_screen(dialog, answers.append)
    await pilot.pause()
    return dialog, answers


@pytest.mark.parametrize(
    "keys, taken",
    [
        ("13", "value 13"),
        ("3", "value 3"),
        ("10", "value 10"),
        ("03", "value 3"),
        ("133", None),
        ("14", None),
        ("99", None),
        ("0", "value 1"),
        ("143", "value 3"),
    ],
)
async def test_two_digits_are_one_number_and_one_that_is_not_there_takes_nothing(full, keys, taken):
    """`13` took line 3, another crop; now a number without a line says so, and Enter takes
    nothing until one is marked again."""
    async with full.run_test(size=(100, 30)) as pilot:
        dialog, answers = await asked(full, pilot, names(13))
        await pilot.press(*keys, "enter")
        assert answers == ([] if taken is None else [taken])
        if taken is None:
            await pilot.press("down", "enter")
            assert len(answers) == 1 and full.screen is not dialog


async def test_after_a_pause_a_digit_begins_a_new_number(full, clock):
    async with full.run_test(size=(100, 30)) as pilot:
        _dialog, answers = await asked(full, pilot, names(13))
        await pilot.press("1")
        clock.now_s += MAX_TYPING_PAUSE_S
        await pilot.press("3", "enter")
        assert answers == ["value 3"]


@pytest.mark.parametrize("size", SIZES)
async def test_every_line_of_a_long_list_is_reached_and_seen_with_a_bar_and_a_count(
    full, shown, size, pilot
):
    await asked(full, pilot, names(60))
    for k in range(1, 61):
        rows = shown(full)
        assert any(f"> {k:>2}  line {k} " in row for row in rows), k
        assert any(f"{k} of 60" in row for row in rows) and any(
            "█" in row or "│" in row for row in rows
        )
        assert any("Enter" in row for row in rows), "the keys stay in sight"
        await pilot.press("down")


async def test_a_click_marks_what_is_seen_there_and_the_wheel_moves_on(full):
    async with full.run_test(size=(80, 24)) as pilot:
        dialog, answers = await asked(full, pilot, names(60))
        await pilot.press("end")
        assert dialog.at == 59
        listed = dialog.query_one(ChoiceList)
        await pilot.click(listed, offset=(3, 0))
        assert dialog.at == 60 - (listed.content_size.height - 1)
        await pilot.press("enter")
        assert answers == [f"value {dialog.at + 1}"]


@pytest.mark.parametrize(
    "keys",
    [
        ("f2", "t"),
        ("f2", "o"),
        ("f2", "h"),
        ("f2", "tab"),
        ("f10", "q"),
        ("f4", "v"),
        ("f10", "j"),
        ("f10", "p"),
        ("f9", "q"),
        ("f3", "b"),
    ],
)
async def test_a_digit_alone_takes_nothing_in_any_list(full, source, keys):
    """In the menu it did, and the Enter that followed answered the next question."""
    async with full.run_test(size=(100, 30)) as pilot:
        await pilot.press(*keys)
        await pilot.pause(0.1)
        assert isinstance(full.screen, ChoiceDialog), keys
        dialog, page = full.screen, full.page
        await pilot.press("2")
        assert (
            full.screen is dialog and full.page is page and dialog.at == 1 and source.orders == []
        )


async def test_the_menu_and_enter_ask_one_question_only(full, source):
    source.current_frame = replace(
        source.current_frame, row=source.current_frame.row._replace(state="held")
    )
    async with full.run_test(size=(100, 30)) as pilot:
        await pilot.press("f10", "q", "5", "enter")
        assert isinstance(full.screen, Confirm) and full.screen.heading == "End this job?"
        assert Order(Do.MARK, "job finished") not in full.source.orders


def test_no_other_list_reads_digits():
    """The rule is in one place."""
    for path in Path(console_app.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if path.name not in (
            "dialogs.py",
            "number_dialog.py",
            "typed_number.py",
            "key_normaliser.py",
            "type_ahead_guard.py",
        ):
            assert "isdigit()" not in text and "isdecimal()" not in text, path
            assert "OptionList" not in text, path


def test_all_crops_of_the_house_are_listed(tmp_path):
    """Two of thirteen could not be reached at any size."""
    facts = JobFiles(
        Launcher((), (), 1, 20.0, str(tmp_path / "run.csv"), tmp_path / "worker.log"), tmp_path
    ).find_facts()
    shipped = {path.stem for path in Path("configs/crops").glob("*.yaml")}
    assert {one.label for one in facts.crops} == shipped
    (tmp_path / "jobs").mkdir()
    for k in range(20):
        (tmp_path / "jobs" / f"own-{k}.yaml").write_text(
            (Path("configs/jobs/demo.yaml")).read_text(encoding="utf-8"), encoding="utf-8"
        )
    facts = JobFiles(
        Launcher((), (), 1, 20.0, str(tmp_path / "run.csv"), tmp_path / "worker.log"), tmp_path
    ).find_facts()
    assert len(facts.jobs) == 20 + len(list(Path("configs/jobs").glob("*.yaml")))


async def test_a_dialog_offers_its_keys_where_the_list_is_short(full):
    async with full.run_test(size=(80, 24)) as pilot:
        dialog, _answers = await asked(full, pilot, names(3), "value 2")
        assert dialog.at == 1 and {one.id for one in dialog.query(Button)} == {"yes", "cancel"}


@pytest.mark.parametrize(
    "key, kind", [(("j",), "job"), (("q", "1", "enter"), "crop"), (("q", "2", "enter"), "machine")]
)
async def test_a_job_s_files_are_walked_to_or_typed_as_a_map_is(full, source, key, kind):
    """Only those of two folders could be taken."""
    desk = full.services.job
    async with full.run_test(size=(100, 30)) as pilot:
        await pilot.press("f10")
        await settled(full, pilot)
        await pilot.press(*key)
        await settled(full, pilot)
        assert [one.label for one in full.screen.choices][-2:] == [
            "look in folders ...",
            "type or paste a path ...",
        ]
        await pilot.press("end", "up", "enter")
        await settled(full, pilot)
        await pilot.press("enter")  # the stick
        await settled(full, pilot)
        assert [one.label for one in full.screen.choices] == ["..", "2026-03-18  north.yaml"]
        await pilot.press("2", "enter")
        await settled(full, pilot)
        assert ("take", kind, "/media/STICK/north.yaml") in desk.asked
        await pilot.press("escape")
        await pilot.press(*key)
        await settled(full, pilot)
        await pilot.press("end", "enter", *"own", "enter")
        await settled(full, pilot)
        assert ("take", kind, "own") in desk.asked


def test_a_folder_lists_files_of_the_kind_that_is_wanted(tmp_path):
    for kind in ("job", "crop", "machine"):
        (tmp_path / f"a-{kind}.yaml").write_text(
            f"# own\nformat: topdress-{kind}/1\n", encoding="utf-8"
        )
    (tmp_path / "zones.geojson").write_text(
        '{"type": "FeatureCollection", "features": []}', encoding="utf-8"
    )
    (tmp_path / "sub").mkdir()
    for kind, name in (
        ("job", "a-job.yaml"),
        ("crop", "a-crop.yaml"),
        ("machine", "a-machine.yaml"),
        ("map", "zones.geojson"),
    ):
        assert [one.name for one in list_entries(tmp_path, kind)] == ["..", "sub/", name]
