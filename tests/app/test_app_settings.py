"""The Settings screen: what is changed takes effect at once and is kept; what cannot be is
refused in one line."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest
from topdress.console.app import actions
from topdress.console.app.action import ANYWHERE
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import Choice
from topdress.console.app.pages.page_registry import SCREEN_CLASSES
from topdress.console.app.pages.settings.page import LANGUAGE_NAMES, SettingsList, ThemeDialog
from topdress.console.app.pages.settings.service import SettingsStore
from topdress.console.app.services import Services
from topdress.console.app.settings import find_key_clash, find_keymap_fault, make_theme
from topdress.console.locale import find_language_code, list_languages
from topdress.control.orders import Do, Order
from topdress.drivers.files.settings import Settings, read_settings, write_settings
from topdress.drivers.files.user_themes import ThemeData

from tests.app.made_up.run import sample_services

SIZE = (120, 40)


@pytest.fixture
def kept(tmp_path):
    """A store on a real file."""
    path = tmp_path / "config" / "settings.yaml"
    return SettingsStore(Settings(), lambda settings: write_settings(path, settings), str(path))


@pytest.fixture
def app(source, clock, kept):
    return TopdressApp(
        source, clock, live=False, utc_offset_s=0.0, services=Services(settings=kept)
    )


async def on_settings(app, pilot, *labels):
    """Go to the Settings screen and, by arrow keys, to the setting of this label."""
    await pilot.press("f11")
    for label in labels:
        rows = [row.label for row in app.page.list_rows()]
        await pilot.press("home", *["down"] * rows.index(label))


def in_file(kept) -> Settings:
    return read_settings(Path(kept.place)).settings


def nothing_written(kept) -> bool:
    return not Path(kept.place).exists()


async def test_a_choice_takes_effect_at_once_and_is_kept(app, kept, pilot):
    await on_settings(app, pilot, "units")
    await pilot.press("enter", "2", "enter")
    assert app.units.id == "imperial" and in_file(kept).units == "imperial"
    await on_settings(app, pilot, "theme")
    await pilot.press("enter", "3", "enter")
    assert app.theme == "contrast" and in_file(kept).theme == "contrast"
    await on_settings(app, pilot, "language")
    await pilot.press("enter", str(list(LANGUAGE_NAMES).index("zh") + 1), "enter")
    assert find_language_code() == "zh" and in_file(kept).language == "zh"


async def test_escape_changes_nothing_and_writes_nothing(app, kept, pilot):
    await on_settings(app, pilot, "units")
    await pilot.press("enter", "2", "escape")
    assert app.units.id == "metric" and nothing_written(kept)


async def test_the_manual_rates_range_is_that_of_the_settings_and_the_crop(app, kept, pilot):
    await on_settings(app, pilot, "highest")
    await pilot.press("enter", *"3000", "enter")
    assert len(app.screen_stack) == 3, "3000 is refused: at most 2000"
    await pilot.press("delete", *"400", "enter")
    assert app.limits_kg_ha == (0.0, 400.0) and in_file(kept).manual_rate.high_kg_ha == 400.0
    await on_settings(app, pilot, "highest")
    await pilot.press("delete")
    assert app.limits_kg_ha == (0.0, 600.0), "the crop's own limit holds beside it"


async def test_a_slower_look_at_maps(app, pilot):
    await on_settings(app, pilot, "maps")
    await pilot.press("enter", "0", "full_stop", "5", "enter")
    assert {page.maps.every_s for page in app.pages.values()} == {2.0}


@pytest.mark.exam
async def test_a_key_of_ones_own_works_and_is_shown(app, kept, source, pilot):
    await on_settings(app, pilot, "start")
    await pilot.press("enter", "j", "enter")
    assert in_file(kept).keymap == {"start": "j"}
    await pilot.press("f2")
    await pilot.press("s", "j")
    assert source.orders == [Order(Do.START)], "s is free now, j starts"
    assert "start" in {a.id for a in actions.list_page_actions("run") if a.shown == "J"}


@pytest.mark.exam
async def test_hold_on_another_key(app, source, pilot):
    await on_settings(app, pilot, "hold")
    await pilot.press("enter", "f7", "enter")
    assert app.notice_text.startswith("refused: key f7: both hold and "), "F7 opens a page"
    await on_settings(app, pilot, "hold")
    await pilot.press("enter", "insert", "enter")
    await pilot.press("space", "insert")
    assert source.orders == [Order(Do.HOLD)]


async def test_a_key_that_is_anothers_is_refused_with_both_names(app, kept, pilot):
    await on_settings(app, pilot, "mark")
    await pilot.press("enter", "s", "enter")
    assert app.notice_text == "refused: key s: both start and mark"
    assert kept.settings.keymap == {} and nothing_written(kept)


async def test_all_defaults_are_asked_once(app, kept, pilot):
    await on_settings(app, pilot, "sound")
    await pilot.press("enter", "2", "enter")
    assert not app.sound and not in_file(kept).sound
    await pilot.press("q", "1", "enter", "escape")
    assert not app.sound
    await pilot.press("q", "1", "enter", "enter")
    assert app.sound and in_file(kept) == Settings()


async def test_a_click_changes_and_the_lock_forbids(app, kept, pilot):
    await on_settings(app, pilot)
    await pilot.click(SettingsList, offset=(6, 2))
    assert len(app.screen_stack) == 3
    await pilot.press("escape", "f8")
    await pilot.click(SettingsList, offset=(6, 3))
    await pilot.press("enter", "q", "1", "enter")
    assert len(app.screen_stack) == 2 and app.notice_text.startswith("locked")


async def test_what_cannot_be_written_is_said_and_not_used(source, clock):
    def full(settings: Settings) -> None:
        raise OSError(28, "No space left on device")

    store = SettingsStore(Settings(), full, "settings.yaml")
    app = TopdressApp(source, clock, live=False, services=Services(settings=store))
    async with app.run_test(size=SIZE) as pilot:
        await on_settings(app, pilot, "units")
        await pilot.press("enter", "2", "enter")
        assert app.units.id == "metric"
        assert app.notice_text == "not kept: settings.yaml: No space left on device"


async def test_a_broken_file_is_told_at_the_start_and_stays_untouched(
    tmp_path, source, clock, shown
):
    path = tmp_path / "settings.yaml"
    path.write_text("format: topdress-settings/1\nunits: furlong\n")
    read = read_settings(path)
    assert read.settings == Settings() and read.trouble.endswith(
        "key units: value furlong: allowed metric, imperial (line 2)"
    )
    store = SettingsStore(
        read.settings, lambda settings: write_settings(path, settings), str(path), read.trouble
    )
    app = TopdressApp(source, clock, live=False, services=Services(settings=store))
    async with app.run_test(size=SIZE) as pilot:
        assert "value furlong" in app.notice_text and app.units.id == "metric"
        await pilot.press("f11")
        app.show_newest()
        await pilot.pause()
        assert any("value furlong" in row for row in shown(app))
    assert "furlong" in path.read_text()


def test_a_keymap_that_cannot_be_used_is_said_in_one_line(source, clock):
    for keymap, said in (
        ({"strat": "q"}, "key keymap.strat: no such action"),
        ({"start": "enter"}, "key keymap.start: value enter: not a key that can be used"),
        ({"start": "r"}, "key r: both start and ready"),
    ):
        assert find_keymap_fault(keymap) == said
        store = SettingsStore(Settings(keymap=keymap), lambda settings: None)
        app = TopdressApp(source, clock, live=False, services=Services(settings=store))
        assert store.trouble == said
        assert "shown" not in vars(app) and actions.list_page_actions("run")[0].shown == "S", (
            "the built-in keys are used"
        )


def test_no_two_built_in_actions_of_a_screen_share_a_key():
    assert find_key_clash({action.id: action.keys for action in actions.ACTIONS}) == ""


def test_settings_of_every_shape_survive_their_file(tmp_path):
    path = tmp_path / "deep" / "settings.yaml"
    settings = Settings(
        units="imperial", language="zh", theme="dusk", sound=False, keymap={"hold": "space,h"}
    )
    write_settings(path, settings)
    assert read_settings(path) == (settings, "")
    assert read_settings(tmp_path / "none.yaml") == (Settings(), "")


def test_every_language_can_be_chosen():
    assert set(get_args(Settings.model_fields["language"].annotation)) == {
        "auto",
        *list_languages(),
    }
    assert set(LANGUAGE_NAMES) == set(get_args(Settings.model_fields["language"].annotation))


async def test_a_theme_of_the_users_own(source, clock):
    data = ThemeData(name="dusk", like="night", colours={"background": "#120e0a", "red": "#ff0000"})
    theme = make_theme(data)
    assert (
        theme.dark and theme.background == "#120e0a" and theme.variables["alarm-red"] == "#ff0000"
    )
    store = SettingsStore(Settings(theme="dusk"), lambda settings: None, themes=(data,))
    app = TopdressApp(source, clock, live=False, services=Services(settings=store))
    assert app.theme == "dusk" and store.trouble == ""
    with pytest.raises(ValueError, match=r"colours\.pink: unknown: allowed background, "):
        ThemeData(name="x", like="day", colours={"pink": "#000000"})


def test_the_tables_of_pages_name_the_same_pages():
    opened = [one.id.removesuffix("_screen") for one in actions.list_page_openers()]
    assert opened == list(SCREEN_CLASSES)
    assert {one.where for one in actions.ACTIONS} - {ANYWHERE} <= set(opened)


async def test_a_theme_is_seen_while_it_is_chosen_and_escape_brings_the_old_one_back(source, clock):
    app = TopdressApp(source, clock, live=False, utc_offset_s=0.0, services=sample_services())
    async with app.run_test(size=(120, 40)) as pilot:
        before = app.theme
        choices = [Choice(name, name) for name in ("day", "night", "contrast")]
        app.push_screen(ThemeDialog("Theme", choices, before))
        await pilot.pause()
        await pilot.press("down")
        assert app.theme != before
        await pilot.press("escape")
        assert app.theme == before
