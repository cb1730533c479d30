"""One word for one thing: the glossary's list of words that are not used holds in every page
and every text of the console; and each of its terms says where it lives."""

from __future__ import annotations

import io
import re
import tokenize
from pathlib import Path

import pytest
from topdress.console.locale.po_reader import read_po

ROOT = Path(__file__).parents[2]
GLOSSARY = ROOT / "docs" / "glossary.md"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if page != GLOSSARY),
]
TEXTS = sorted((ROOT / "console" / "locale" / "zh").glob("*.po"))


def _rows(text: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("|") and not line.startswith("|-")
    ]


def _refused() -> re.Pattern[str]:
    listed = _rows(GLOSSARY.read_text(encoding="utf-8").split("## Instead of")[1])[1:]
    words = sorted({cells[0].split(" (")[0] for cells in listed})
    assert {"told", "beside", "begun", "hum", "ladder", "boxes", "tangled"} <= set(words)
    return re.compile(rf"\b({'|'.join(words)}s?)\b(?! apart)", re.IGNORECASE)


def _in_words(page: str) -> str:
    """Without code, names of files and targets of links."""
    return re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)|(?m:^    .*$)", " ", page, flags=re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_page_uses_a_word_that_the_glossary_replaces(page: Path) -> None:
    refused = _refused()
    found = [
        line.strip()
        for line in _in_words(page.read_text(encoding="utf-8")).splitlines()
        if refused.search(line)
    ]
    assert found == []


@pytest.mark.parametrize("texts", TEXTS, ids=lambda path: path.stem)
def test_no_text_of_the_console_does(texts: Path) -> None:
    refused = _refused()
    assert [
        said for said in read_po(texts.read_text(encoding="utf-8")) if refused.search(said)
    ] == []


def _words_of(source: str) -> list[str]:
    """Comments, docstrings and names of a source; texts are held by the pages and the .po files."""
    words = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        prose = token.type == tokenize.COMMENT or (
            token.type == tokenize.STRING and token.string.startswith('"""')
        )
        if prose or token.type == tokenize.NAME:
            words.append(
                token.string.strip("_").replace("_", " ")
                if token.type == tokenize.NAME
                else token.string
            )
    return words


# in logs and files
PUBLISHED = re.compile(r"\b(speed told|told mm|told rpm|zones beside grid|shapefiles beside)\b")
A_THING = re.compile(r"\bboxes\b")  # around granules in a picture


@pytest.mark.parametrize("room", ["control", "drivers", "console", "benchmarks"])
def test_no_source_does(room: str) -> None:
    """In comments, docstrings and names."""
    refused = _refused()
    found = [
        f"{path.relative_to(ROOT)}: {words}"
        for path in sorted((ROOT / room).rglob("*.py"))
        for words in _words_of(path.read_text(encoding="utf-8"))
        if refused.search(A_THING.sub("", PUBLISHED.sub("", words.replace("_", " "))))
    ]
    assert found == []


def test_each_term_has_a_meaning_and_a_place_that_is_there() -> None:
    text = GLOSSARY.read_text(encoding="utf-8").split("## Instead of")[0]
    rows = [cells for cells in _rows(text) if cells[0] != "term"]
    assert len(rows) >= 40 and len({cells[0] for cells in rows}) == len(rows)
    for term, meaning, _unit, where in rows:
        assert len(meaning) > 15, term
        for file in re.findall(r"`((?:control|console|drivers)/[\w/.]+)`", where):
            assert (ROOT / file).exists(), (term, file)
