"""Which tests run the line of a fault: seen by a probe at its place while a whole set of tests runs once.

The tests that can import a file are nearly all of them; those that run one line of it are few. A probe stands in the
sources, as `(__reached__(3) or (a - b))` for `a - b`, and writes down the test that pytest says is running; programs
that a test starts say the same test. What numba compiles bears no probe.
"""
from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from fault_kinds import Fault, Source

COMPILED = "control/machine/"               # numba's: no probe can stand there
PROBE = '''

def __reached__(number, seen=set()):
    import os
    test = os.environ.get("PYTEST_CURRENT_TEST", "")
    if (number, test) not in seen:
        seen.add((number, test))
        with open({path!r}, "a", encoding="utf-8") as out:
            out.write(f"{{number}}\\t{{test}}\\n")
'''


def probed(text: str, faults: Mapping[int, Fault], path: Path) -> str:
    """A source with probes, by their numbers, at the places of these faults of it; `path`: what they write to."""
    spans = _spans(text, faults)
    marks = [(start, 1, f"(__reached__({number}) or (") for number, (start, _) in spans.items()]
    marks += [(end, 0, "))") for _, end in spans.values()]
    for at, _, mark in sorted(marks, reverse=True):
        text = text[:at] + mark + text[at:]
    return text + PROBE.format(path=str(path))


def _spans(text: str, faults: Mapping[int, Fault]) -> dict[int, tuple[int, int]]:
    """The smallest expression around each fault."""
    source = Source("", text)
    nodes = [source.span(node) for node in ast.walk(ast.parse(text)) if isinstance(node, ast.expr)]
    return {number: min((span for span in nodes if span[0] <= fault.start and fault.end <= span[1]),
                        key=lambda span: span[1] - span[0]) for number, fault in faults.items()}


def can_be_probed(fault: Fault) -> bool:
    return not fault.file.startswith(COMPILED)


def reached_by(lines: Iterable[str], faults: Sequence[Fault]) -> dict[str, list[str]]:
    """Fault's id -> tests that ran its line, in the order in which they did; "" among them: while it was imported."""
    found: dict[str, dict[str, None]] = {}
    for line in lines:
        number, _, test = line.rstrip("\n").partition("\t")
        found.setdefault(faults[int(number)].id, {})[test.rpartition(" (")[0]] = None
    return {name: list(tests) for name, tests in found.items()}
