"""The published schemas are those of the models, and the command tells them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from topdress.console.cli.check import format_schema, list_kinds_by_name
from topdress.control.log_row import ALL_COLUMNS

from tests.command import topdress

PUBLISHED = Path(__file__).parents[2] / "schemas"
KINDS = sorted(list_kinds_by_name())


@pytest.mark.parametrize("kind", KINDS)
def test_the_published_schema_is_fresh(kind: str) -> None:
    text = (PUBLISHED / f"{kind}.json").read_text(encoding="utf-8")
    assert text == format_schema(kind), "write them anew: topdress check --write-schemas schemas"


def test_nothing_else_is_published() -> None:
    assert sorted(path.stem for path in PUBLISHED.iterdir()) == KINDS


@pytest.mark.parametrize("name", ["cab", "topdress-cab/1"])
def test_a_schema_is_told_by_name_or_format(name: str) -> None:
    result = topdress("check", "--schema", name)
    assert result.exit_code == 0
    told = json.loads(result.output)
    assert (
        told["properties"]["format"] == {"const": "topdress-cab/1"}
        and told["additionalProperties"] is False
    )
    assert told["$defs"]["BoardConfig"]["properties"]["max_shaft_rpm"]["maximum"] == 300


def test_the_columns_of_a_run_log_are_told() -> None:
    told = json.loads(topdress("check", "--schema", "run-log").output)["properties"]
    assert list(told) == list(ALL_COLUMNS)
    assert told["supply_v"] == {
        "type": ["number", "null"],
        "unit": "V",
        "plausible": [0.0, 60.0],
        "description": "supply voltage",
    }
    assert told["state"]["type"] == ["string", "null"]
    assert told["satellites"]["type"] == ["integer", "null"]


def test_all_are_written_to_a_folder(tmp_path: Path) -> None:
    result = topdress("check", "--write-schemas", tmp_path / "new")
    assert result.exit_code == 0 and len(result.output.splitlines()) == len(KINDS)
    for kind in KINDS:
        assert (tmp_path / "new" / f"{kind}.json").read_bytes() == (
            PUBLISHED / f"{kind}.json"
        ).read_bytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["check"], "no file given"),
        (["check", "--schema", "boat"], "allowed is one of machine, crop"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(arguments: list[str], said: str) -> None:
    result = topdress(*arguments)
    assert result.exit_code == 2 and said in result.output and len(result.output.splitlines()) == 1
