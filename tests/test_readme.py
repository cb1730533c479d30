"""README names every page of the console and every command."""
from __future__ import annotations

import re
from pathlib import Path

from console.app import actions
from console.cli import app

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def rows(head: str) -> list[str]:
    """Rows of the table with this head."""
    after = README[README.index(head):].splitlines()[2:]
    return after[:next(k for k, line in enumerate(after) if not line.startswith("|"))]


def test_pages_with_their_keys() -> None:
    told = [tuple(cell.strip(" `").lower() for cell in row.split("|")[1:3]) for row in rows("| page |")]
    assert told == [(one.label, one.shown.lower()) for one in actions.pages()]


def test_commands() -> None:
    told = " ".join(row.split("|")[1] for row in rows("| command |"))
    assert set(re.findall(r"`topdress ([a-z-]+)", told)) == {
        one.name for one in (*app.registered_commands, *app.registered_groups)}
