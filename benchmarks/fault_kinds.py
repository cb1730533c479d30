"""Faults that a slip of the hand makes: where in a source each kind can be put, and a seeded choice of them.

A sign: `a + b` for `a - b`, or a minus left out. A bound: `min` for `max`, a limit twice as large, `<=` for `<` at a
whole number. A unit: 60, 3.6, 1000 and their like divided by in place of multiplied with. A missing branch: an `if`
that never holds. They are mutation operators (DeMillo, Lipton and Sayward, Computer 11(4), 1978) of slips that neither
an interpreter nor a type checker sees.
"""
from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

ROOMS = ("control", "drivers", "console")
KINDS = ("sign", "bound", "unit", "branch")
# Not of the program itself: Chinese, made pictures and what they show, boards' programs (these run on no PC).
LEFT_OUT = ("console/locale/", "console/app/gallery.py", "sample", "drivers/board/")
UNITS = {3.6, 10.0, 60.0, 100.0, 180.0, 1000.0, 3600.0, 10000.0}
OTHER_SIGN = {ast.Add: "-", ast.Sub: "+"}
OTHER_UNIT = {ast.Mult: "/", ast.Div: "*"}
EDGES = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
SWAPPED = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
TEXTS = (ast.JoinedStr, ast.List, ast.Tuple, ast.Dict, ast.ListComp)


class Fault(NamedTuple):
    """`text[start:end]` of the file becomes `new`."""

    file: str                   # of the tree, with /
    line: int
    kind: str
    start: int
    end: int
    old: str
    new: str
    id: str                     # file and a hash of its line: what stands elsewhere does not change it

    def put_into(self, text: str) -> str:
        assert text[self.start:self.end] == self.old, f"{self.file} is another file than the fault was chosen for"
        return text[:self.start] + self.new + text[self.end:]


def chosen(tree: Path, count: int, seed: int) -> list[Fault]:
    """`count` faults of a tree of sources, as many of each kind and room as can be; the same for the same seed.

    A source that changes takes away its own faults and brings others: the choice of the rest stays.
    """
    pools: dict[tuple[str, str], list[Fault]] = {(kind, room): [] for room in ROOMS for kind in KINDS}
    for room in ROOMS:
        for path in sorted((tree / room).rglob("*.py")):
            name = path.relative_to(tree).as_posix()
            if not any(part in name for part in LEFT_OUT):
                for fault in possible(name, path.read_text(encoding="utf-8")):
                    pools[fault.kind, room].append(fault)
    for pool in pools.values():
        pool.sort(key=lambda fault: _hash(f"{seed} {fault.id}"), reverse=True)
    order = [list({fault.id: fault for fault in pools[kind, room]}.values()) for kind in KINDS for room in ROOMS]
    found: list[Fault] = []
    while len(found) < count and any(order):
        found += [pool.pop() for pool in order if pool][:count - len(found)]
    return found


def possible(file: str, text: str) -> list[Fault]:
    """Every fault that can be put into one source."""
    source = Source(file, text)
    return [fault for node in ast.walk(ast.parse(text)) for fault in _of_node(source, node)]


class Source:
    """Offsets in the text of what the parser counts in lines and bytes."""

    def __init__(self, file: str, text: str) -> None:
        self.file, self.text = file, text
        self._lines = text.splitlines(keepends=True)
        self._starts = [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line))

    def at(self, line: int, column: int) -> int:
        return self._starts[line - 1] + len(self._lines[line - 1].encode()[:column].decode())

    def span(self, node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None and node.end_col_offset is not None
        return self.at(node.lineno, node.col_offset), self.at(node.end_lineno, node.end_col_offset)

    def fault(self, kind: str, start: int, end: int, new: str) -> Fault:
        line = self.text.count("\n", 0, start) + 1
        old, code = self.text[start:end], self._lines[line - 1].strip()
        name = f"{self.file}:{_hash(f'{kind} {code} {old} {new} {start - self._starts[line - 1]}')[:8]}"
        return Fault(self.file, line, kind, start, end, old, new, name)

    def operator(self, kind: str, left: ast.expr, right: ast.expr, old: str, new: str) -> Iterator[Fault]:
        """The operator between two operands, where it stands alone there."""
        start, end = self.span(left)[1], self.span(right)[0]
        between = self.text[start:end]
        if between.count(old) == 1 and "#" not in between:
            at = start + between.index(old)
            yield self.fault(kind, at, at + len(old), new)


def _of_node(source: Source, node: ast.AST) -> Iterator[Fault]:
    if isinstance(node, ast.BinOp):
        yield from _of_operation(source, node)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        start = source.span(node)[0]
        yield source.fault("sign", start, start + 1, "")
    elif isinstance(node, ast.Call):
        yield from _of_call(source, node)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        yield from _of_compare(source, node)
    elif isinstance(node, ast.If) and not node.orelse and "__name__" not in ast.dump(node.test) \
            and "TYPE_CHECKING" not in ast.dump(node.test):
        start, end = source.span(node.test)
        yield source.fault("branch", start, end, f"False and ({source.text[start:end]})")


def _of_operation(source: Source, node: ast.BinOp) -> Iterator[Fault]:
    sides = (node.left, node.right)
    if type(node.op) in OTHER_SIGN and not any(isinstance(one, TEXTS) or _is_text(one) for one in sides):
        yield from source.operator("sign", *sides, "+" if isinstance(node.op, ast.Add) else "-",
                                   OTHER_SIGN[type(node.op)])
    if type(node.op) in OTHER_UNIT and any(isinstance(one, ast.Constant) and _is_unit(one.value) for one in sides):
        yield from source.operator("unit", *sides, "*" if isinstance(node.op, ast.Mult) else "/",
                                   OTHER_UNIT[type(node.op)])


def _of_call(source: Source, node: ast.Call) -> Iterator[Fault]:
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if name in SWAPPED and len(node.args) > 1:
        end = source.span(node.func)[1]
        yield source.fault("bound", end - len(name), end, SWAPPED[name])


def _of_compare(source: Source, node: ast.Compare) -> Iterator[Fault]:
    operator, limit = node.ops[0], node.comparators[0]
    if type(operator) not in EDGES:
        return
    if isinstance(limit, ast.Constant) and isinstance(limit.value, int):
        old = {"<=": "<", "<": "<=", ">=": ">", ">": ">="}[EDGES[type(operator)]]
        yield from source.operator("bound", node.left, limit, old, EDGES[type(operator)])
    elif not (isinstance(limit, ast.Constant) and limit.value == 0.0):
        start, end = source.span(limit)
        yield source.fault("bound", start, end, f"2 * ({source.text[start:end]})")


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, (str, bytes))


def _is_unit(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and float(value) in UNITS


def by_kind(faults: Sequence[Fault]) -> dict[str, int]:
    return {kind: sum(fault.kind == kind for fault in faults) for kind in KINDS}
