"""Before anything loads numpy: as in the program, matrices get one thread."""

from __future__ import annotations

import gc
import signal
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
import typer.testing
from click.testing import Result
from topdress.console.thread_limits import limit_matrix_threads

limit_matrix_threads()
# Python looks for garbage after 700 new objects, and through all 10^6 of a session after some
# 70,000: a third of what a test of the console costs (127 tests of its number fields: 11.0 s of
# processor, 7.0 s with these).
gc.set_threshold(20_000, 20, 20)

# Typer's runner makes all commands anew for each call: 0.13 s, half of what a test of the
# command line costs.
typer.testing._get_command = cache(typer.main.get_command)  # type: ignore[attr-defined]

# A shell that starts a job in the background has it ignore Ctrl+C; every program that the tests
# start inherits that.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# of a test of the exam, some of which run for minutes; of the others: pyproject.toml
EXAM_S = 1800.0
# Cases that belong to `make exam` (the file says why).
REPEATED_CASES = frozenset(
    (Path(__file__).parent / "repeated_cases.txt").read_text(encoding="utf-8").splitlines()
)


@pytest.hookimpl(tryfirst=True)
def pytest_itemcollected(item: pytest.Item) -> None:
    """Marks the cases that repeat others. No test runs for ever: one that a fault makes loop
    fails, and the rest still says what it has to say."""
    if item.nodeid in REPEATED_CASES:
        item.add_marker("exam")
    if item.get_closest_marker("exam") and not item.get_closest_marker("timeout"):
        item.add_marker(pytest.mark.timeout(EXAM_S))


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Each room's files are spread over the whole run, those of many tests first: files that
    compute (diagnosis, the loop) run beside files that wait for a screen or a started program,
    and none has much left at the end."""
    tests = Counter(item.path for item in items)
    rooms: dict[Path, list[Path]] = {}
    for file in sorted(tests, key=lambda one: -tests[one]):
        rooms.setdefault(file.parent, []).append(file)
    place = {
        file: (k + 0.5) / len(files) for files in rooms.values() for k, file in enumerate(files)
    }
    items.sort(key=lambda item: (place[item.path], str(item.path)))


def pytest_collection_finish() -> None:
    """What was imported and collected stays to the end: it is never looked through again."""
    gc.freeze()


def pytest_report_header(config: pytest.Config) -> str | None:
    """Which of the two sets runs: a test of the other one, though named by its path, is only
    counted as deselected."""
    chosen = config.getoption("markexpr")
    return (
        "the quick set; the rest: -m exam (make exam); both: -m ''"
        if chosen == "not exam"
        else None
    )


@pytest.fixture(scope="session")
def topdress() -> Callable[..., Result]:
    """Runs the command with these arguments."""
    from tests.command import topdress

    return topdress


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Writes a text or bytes to a file of this test and gives its path."""

    def write(content: str | bytes, name: str = "log.csv", encoding: str = "utf-8") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode(encoding) if isinstance(content, str) else content)
        return path

    return write


# characters of a parameter's id: some are files of a megabyte, and would flood a terminal
LONGEST_ID = 60


def pytest_make_parametrize_id(val: object) -> str | None:
    """The beginning of a long text, and how long it is; else pytest's own id."""
    if not isinstance(val, (str, bytes)) or len(val) <= LONGEST_ID:
        return None
    return f"{ascii(val[: LONGEST_ID // 3]).strip(chr(39) + chr(34) + 'b')}...{len(val)}"
