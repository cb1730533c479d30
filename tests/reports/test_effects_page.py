"""The page of effects is the catalogue, and nothing else."""

from __future__ import annotations

from pathlib import Path

from topdress.console.reports.effects_page import format_effects_page
from topdress.control.machine.machine import CATALOGUE

from tests.command import topdress

PAGE = Path(__file__).parents[2] / "docs" / "effects.md"


def test_page_is_the_catalogue() -> None:
    assert PAGE.read_text(encoding="utf-8") == format_effects_page(CATALOGUE), (
        "write it again: topdress effects --markdown docs/effects.md"
    )


def test_page_says_all_of_each_effect() -> None:
    text = format_effects_page(CATALOGUE)
    for effect_id, entry in CATALOGUE.items():
        part = text.split(f"### {effect_id}\n")[1].split("\n##")[0]
        for said in (
            entry.effect.title,
            entry.effect.physics,
            entry.effect.source,
            entry.effect.advice,
            entry.effect.separate,
            entry.effect.unit,
            *entry.effect.seen_in,
        ):
            assert said in part
    assert text.count("\n### ") == len(CATALOGUE)


def test_command_writes_the_page(tmp_path: Path) -> None:
    out = tmp_path / "effects.md"
    result = topdress("effects", "--markdown", out)
    assert result.exit_code == 0 and result.output == ""
    assert out.read_text(encoding="utf-8") == format_effects_page(CATALOGUE)
