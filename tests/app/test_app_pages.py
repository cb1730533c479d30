"""A page is complete: registered, opened by a key, with its own keys, a picture and a row of the
documentation; a browser's tab knows what it may do there."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest
from topdress.console.app import actions, pages
from topdress.console.app.action import DEVICES, JOB, RUN
from topdress.console.app.pages.page_registry import SCREEN_CLASSES
from topdress.console.app.tablet_app import VIEW_ONLY_PAGES, WRITING_PAGES

from tests.app.gallery import PICTURES

FOLDERS = sorted(path.parent.name for path in Path(pages.__file__).parent.glob("*/page.py"))
# Pages whose keys order something of the machine, but write no file.
MACHINE_PAGES = {RUN, DEVICES, JOB}
TABLE = Path(__file__).parents[2] / "docs" / "screens" / "README.md"


def test_every_page_is_registered() -> None:
    assert FOLDERS == sorted(SCREEN_CLASSES)


@pytest.mark.parametrize("name", FOLDERS)
def test_page_is_complete(name: str) -> None:
    assert (Path(pages.__file__).parent / name / "__init__.py").exists()
    own = import_module(f"topdress.console.app.pages.{name}.keys").ACTIONS
    assert set(own) <= set(actions.ACTIONS), "console/app/actions.py"
    opens = actions.BY_ID.get(f"{name}_screen")
    assert opens is not None, "console/app/common_keys.py"
    assert name in WRITING_PAGES | VIEW_ONLY_PAGES | MACHINE_PAGES, "console/app/tablet_app.py"
    assert name in {one.screen for one in PICTURES}, "tests/app/gallery.py"
    row = f"| {name.capitalize()} | `{opens.shown}` |"
    assert row in TABLE.read_text(encoding="utf-8"), "docs/screens/README.md"
