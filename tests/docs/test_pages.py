"""The pages of docs with commands: each command is run, in the page's order, and says what the
page shows.

Words must be the same, and numbers to 2 % or one of their last digit: other processors round
otherwise. `...` stands for anything: for part of a line, or by itself for any lines. `python -m
tests.docs.test_pages PAGE.md` writes the numbers of today into a page whose words still hold.
"""

from __future__ import annotations

import math
import re
import runpy
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from topdress.console.app import actions
from topdress.console.cli import app

from tests.command import topdress

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
NUMBER = re.compile(r"\d{4}-\d\d-\d\d|(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
NEAR = 0.02  # of a number on the page: share of it
# The guides drive and diagnose for 10 to 40 s of processor each.
PAGES = (
    "import.md",
    *(
        pytest.param(f"guides/{name}.md", marks=pytest.mark.exam)
        for name in ("first-day", "engineer", "researcher")
    ),
)


def shown(page: str) -> list[tuple[str, str]]:
    """Commands on a page, in order, with what they say there."""
    blocks = re.findall(
        r"```console\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL
    )
    pieces = [
        piece for block in blocks for piece in re.split(r"^\$ ", block, flags=re.MULTILINE) if piece
    ]
    return [(command, said) for command, _, said in (piece.partition("\n") for piece in pieces)]


def numbers_of(said: str, page: str) -> list[str] | None:
    """The output's numbers where the page has its own; None: the page has other words."""
    parts = re.split(r"^\.\.\.\n|\.\.\.", NUMBER.sub("\0", page), flags=re.MULTILINE)
    pattern = ".*?".join(
        re.escape(re.sub(r" +", " ", part)).replace("\0", f"({NUMBER.pattern})") for part in parts
    )
    found = re.fullmatch(pattern, re.sub(r" +", " ", said), re.DOTALL)
    return None if found is None else list(found.groups())


def is_as_shown(said: str, page: str) -> bool:
    """Whether an output has the page's words in their places, and numbers near the page's."""
    found = numbers_of(said, page)
    return found is not None and all(map(is_near, NUMBER.findall(page), found))


def is_near(shown: str, said: str) -> bool:
    last_digit = 10.0 ** -len(shown.partition(".")[2])
    return "-" in shown[1:] or math.isclose(
        float(shown), float(said), rel_tol=NEAR, abs_tol=1.01 * last_digit
    )


def run_as(command: str) -> Result:
    return topdress(*shlex.split(command)[1:])


@pytest.fixture
def there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as a reader's: the pages' examples, and nothing else."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "examples").symlink_to(DOCS / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES)
def test_every_command_says_what_the_page_shows(page: str, there: Path) -> None:
    commands = shown(page)
    assert len(commands) >= 6
    for command, said in commands:
        result = run_as(command)
        assert is_as_shown(result.output, said), f"{page}: {command}\n{result.output}"
        refused = "not imported" in said
        assert result.exit_code == (2 if refused else 0), command


@pytest.mark.parametrize(
    ("page", "said", "same"),
    [
        ("3 rows, 60 s\n", "3 rows, 60 s\n", True),
        ("3 rows, 60 s\n", "3 lines, 60 s\n", False),
        ("error 5.2 kg\n", "error 5.3 kg\n", True),
        ("error 5.2 kg\n", "error 5.4 kg\n", False),
        ("-6.63 %\n", "-6.70 %\n", True),
        ("-6.63 %\n", "-5.99 %\n", False),
        ("p 0.002\n", "p 0.003\n", True),
        ("a\n...\nz\n", "a\nb 1\nc\n\nz\n", True),
        ("a\n...\nz\n", "a\nb\n", False),
        ("one; ...\n", "one; 2\n", True),
        ("2026-07-01, from a\n", "2031-12-24, from a\n", True),
        ("", "something\n", False),
        ("...\n", "", True),
    ],
)
def test_words_are_held_and_numbers_nearly(page: str, said: str, same: bool) -> None:
    assert is_as_shown(said, page) is same


# --- Every link of every page leads somewhere, and the table of contents has every page
# ------------------------------

LINKED_PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives the headings of a page, and those that the page sets itself."""
    text = page.read_text(encoding="utf-8")
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads} | set(
        re.findall(r'<a id="([^"]+)">', text)
    )


def links(page: Path) -> list[str]:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if not re.match(r"[a-z]+:", link)]


@pytest.mark.parametrize(
    "page", LINKED_PAGES, ids=[str(page.relative_to(ROOT)) for page in LINKED_PAGES]
)
def test_links_lead_somewhere(page: Path) -> None:
    for link in links(page):
        path, _, anchor = link.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{link}: no such file"
        assert not anchor or anchor in anchors(there), f"{link}: no such heading"


def test_the_table_of_contents_has_every_page() -> None:
    contents = ROOT / "docs" / "README.md"
    named = {(contents.parent / link.partition("#")[0]).resolve() for link in links(contents)}
    pages = {page for page in (ROOT / "docs").rglob("*.md") if page != contents}
    assert pages - named == set()


@pytest.mark.parametrize(
    "page", sorted(DOCS.rglob("*.md")), ids=lambda page: str(page.relative_to(DOCS))
)
def test_a_page_begins_with_who_needs_it(page: Path) -> None:
    title, first, *_ = (line for line in page.read_text(encoding="utf-8").splitlines() if line)
    assert title.startswith("# ") and first.startswith("For ")


@pytest.mark.parametrize(
    "page", sorted((DOCS / "decisions").glob("*.md")), ids=lambda page: page.stem
)
def test_a_decision_is_context_decision_consequences(page: Path) -> None:
    heads = re.findall(r"^## (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert heads == ["Context", "Decision", "Consequences"]


def test_the_readme_is_one_screen_that_leads_to_the_guides() -> None:
    assert {
        "docs/README.md",
        "docs/guides/first-day.md",
        "docs/guides/engineer.md",
        "docs/guides/researcher.md",
    } <= set(links(ROOT / "README.md"))
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 60


# --- Every page of the console with its key, and every command
# ------------------------------------------------------


def first_columns(page: str) -> list[list[str]]:
    """The first two cells of each row of a page's first table, without its code marks."""
    _, table = (DOCS / page).read_text(encoding="utf-8").split("|---|", 1)
    return [
        [cell.strip(" `") for cell in row.split("|")[1:3]]
        for row in table.partition("\n\n")[0].splitlines()[1:]
    ]


def test_the_pages_of_the_console_with_their_keys() -> None:
    assert [(page.lower(), key) for page, key in first_columns("screens/README.md")] == [
        (one.label, one.shown) for one in actions.list_page_openers()
    ]


def test_every_command_is_on_its_page() -> None:
    cells = " ".join(command for command, _ in first_columns("command-line.md"))
    assert set(re.findall(r"\btopdress ([a-z-]+)", cells)) == {
        one.name for one in (*app.registered_commands, *app.registered_groups)
    }


# --- `python -m benchmarks`: its index, and that every benchmark that a page names is in it
# --------------------------

NAMED = re.compile(r"python -m benchmarks ([a-z_]+(?:/[a-z_]+)?)|benchmarks/([a-z_/]+)\.py")


@pytest.fixture(scope="module")
def program() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "benchmarks" / "__main__.py"), run_name="index")


def test_every_benchmark_says_in_a_line_what_it_asks(program: dict[str, Any]) -> None:
    found = program["index"]()
    assert {"loss_table", "diagnosis/run"} <= found.keys() and "verdict" not in found
    assert all(10 < len(said) <= 130 for said in found.values()), found


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_what_a_page_names_is_there(page: Path, program: dict[str, Any]) -> None:
    names = [first or second for first, second in NAMED.findall(page.read_text(encoding="utf-8"))]
    folder = ROOT / "benchmarks"
    assert [
        name
        for name in names
        if not ((folder / f"{name}.py").exists() or (folder / name / "__main__.py").exists())
    ] == []


def test_an_unknown_name_is_refused_in_a_line(
    program: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    main: Callable[[list[str]], int] = program["main"]
    assert main(["nothing"]) == 2
    assert capsys.readouterr().err.startswith("nothing: no such benchmark; allowed: ")
    assert main([]) == 0 and "loss_table" in capsys.readouterr().out


if __name__ == "__main__":
    import os
    import sys
    import tempfile

    place = DOCS / sys.argv[1]
    whole = place.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "docs").mkdir()
        (Path(folder) / "docs" / "examples").symlink_to(DOCS / "examples")
        os.chdir(folder)
        for command, said in shown(sys.argv[1]):
            now = numbers_of(run_as(command).output, said)
            assert now is not None, f"{command}: its words are others"
            line = f"$ {command}\n"
            values = iter(
                [
                    old if "-" in old[1:] else new
                    for old, new in zip(NUMBER.findall(said), now, strict=True)
                ]
            )
            whole = whole.replace(
                line + said, line + NUMBER.sub(lambda _, values=values: next(values), said)
            )
    place.write_text(whole, encoding="utf-8")


@pytest.mark.parametrize("folder", ["machines", "jobs", "crops", "products", "cabs"])
def test_what_is_shipped_is_listed(folder: str) -> None:
    page = (ROOT / "docs" / "format-config.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith(f"| {folder} | `"))
    shipped = sorted(path.stem for path in (ROOT / "configs" / folder).glob("*.yaml"))
    assert re.findall(r"`([^`]+)`", row) == shipped
