"""docs/troubleshooting.md shows messages as the program prints them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
MESSAGES = re.findall(r"^\| `([^|]+?)`[^|`]*\|", PAGE, re.MULTILINE)


@pytest.fixture(scope="module")
def source() -> str:
    """Returns all code of the program, texts that go on in a next line joined."""
    code = "\n".join(
        path.read_text(encoding="utf-8")
        for room in ("console", "drivers", "control")
        for path in sorted((ROOT / room).rglob("*.py"))
    )
    return re.sub(r"\"\s*\n\s*f?\"", "", code)


def test_the_page_has_the_messages_that_users_meet_most() -> None:
    assert 25 <= len(MESSAGES) == len(set(MESSAGES)) <= 40


@pytest.mark.parametrize("message", MESSAGES)
def test_each_piece_of_a_message_is_a_text_of_the_program(message: str, source: str) -> None:
    pieces = [piece for piece in message.split("...") if re.search(r"[a-z]{4}", piece)]
    assert pieces
    for piece in pieces:
        assert piece.strip(" :;,.'") in source, piece
