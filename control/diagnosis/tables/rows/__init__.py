"""Bench tables as pieces, a file a kind: what each row measured, and what the machine model says of it."""
from __future__ import annotations

from collections.abc import Callable

from control.calibration.bench_table import BenchTable
from control.diagnosis.tables.piece import TablePiece
from control.machine.machine import Machine

from . import catch, heads, lag, place, weigh

_BY_KIND: dict[str, Callable[[BenchTable, Machine], tuple[TablePiece, ...]]] = {
    "lag": lag.pieces, "catch": catch.pieces, "weigh": weigh.pieces, "heads": heads.pieces, "place": place.pieces}


def pieces_of(table: BenchTable, machine: Machine) -> tuple[TablePiece, ...]:
    """A piece for each measured column of a usable table (control.calibration.bench_table.usable)."""
    return _BY_KIND[table.kind](table, machine)
