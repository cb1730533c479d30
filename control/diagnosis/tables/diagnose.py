"""Bench tables to a diagnosis: show, name, say what else it could be, measure the gain, plan the next test."""
from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import t as student

from control.calibration.bench_table import BenchTable, usable
from control.diagnosis.result import (
    STRUCTURE_P,
    Cause,
    Channel,
    Data,
    Diagnosis,
    FieldCost,
    Rival,
    Size,
    Unexplained,
    Verdict,
)
from control.machine.machine import CATALOGUE, Machine

from .algebra import space_of, subset
from .clock import LEVEL as CLOCK_LEVEL
from .clock import UNDECIDED, Clock
from .cost import field_cost
from .detectable import CLOCK, not_shown
from .evidence import gains
from .experiments import next_run
from .piece import Piece, Sized
from .problem import Problem, problem_of
from .report import clock_sentence, label_sentences, level_sentence, scatter_sentences, scope_sentences
from .rows import BUILDERS
from .selection import Found, Named, named
from .unexplained import LEVEL as LEFT_LEVEL
from .unexplained import Left, left_over

Progress = Callable[[float, str], None]
CATALOGUE_TOO_LITTLE = 0.6      # of the structure found; below it the catalogue does not explain it
CONSTANT_TIMES = ("lag.offset", "shaft.dead_time")      # what one rounded reading throughout could be instead
WORTH_SAYING = 0.15             # of the structure found, for what is left beside named effects


def diagnose_tables(tables: Sequence[BenchTable], machine: Machine, *, seed: int = 0,
                    progress: Progress | None = None) -> Diagnosis:
    """Diagnoses one bench table, or several of the same machine together.

    `seed`: of the draws behind the p-values; the same seed gives the same diagnosis. `progress(share, what)` is called
    between stages; an exception raised by it cancels. Raises ValueError with one line for tables that cannot be used.
    """
    if not tables:
        raise ValueError("no table given: at least one is needed")
    tell = progress or (lambda share, what: None)
    tables = [usable(table) for table in tables]
    made = [(table, piece) for table in tables for piece in BUILDERS[table.kind](table, machine)]
    pieces = [piece for _, piece in made]
    _refuse_twins(pieces)
    tell(0.1, "noise and steps in the times")
    problem = problem_of(pieces, machine, seed + 20)
    tell(0.2, "search")
    found = named(problem, seed)
    tell(0.6, "what is left")
    left = left_over(problem, found.parts, seed + 10)
    found, verdict, unexplained = _verdict(problem, found, left, seed)
    clocks = [(k, clock) for k, clock in enumerate(problem.clocks) if clock is not None and clock.p < CLOCK_LEVEL]
    if clocks and verdict == "none":
        verdict = "named"
    if verdict == "none" and found.structure_p < STRUCTURE_P:
        verdict, unexplained = "unexplained", (_not_noise(problem, left),)
    causes = _causes(problem, tables, found, clocks)
    if verdict == "named" and any(cause.rivals for cause in causes):
        verdict = "ambiguous"
    told = frozenset([*(c.id for c in causes), *(r.id for c in causes for r in c.rivals)])
    smallest = [clock.smallest_s for clock in problem.clocks if clock is not None and clock.smallest_s is not None]
    tell(0.9, "gain")
    findings = _findings(problem, tables, made, found, clocks, left)
    return Diagnosis(
        data=Data(" + ".join(table.path for table in tables), "+".join(dict.fromkeys(t.kind for t in tables)),
                  sum(table.rows for table in tables), None, machine.id),
        channels=_channels(problem, found), verdict=verdict, causes=causes,
        not_shown=not_shown(problem, found, told, min(smallest, default=None)), unexplained=unexplained,
        next_run=next_run(machine, [[one.part, *(Sized(r.choice, r.size) for r in one.rivals)] for one in found.found]),
        gain=gains(problem, found.parts, seed), extended_machine=None, findings=findings)


def _refuse_twins(pieces: Sequence[Piece]) -> None:
    names = [piece.name for piece in pieces]
    for name in names:
        if names.count(name) > 1 and name.split(" ")[0]:
            raise ValueError(f"{name}: given twice: each table once")


def _verdict(problem: Problem, found: Named, left: Left | None,
             seed: int) -> tuple[Named, Verdict, tuple[Unexplained, ...]]:
    if left is not None and left.p < LEFT_LEVEL:
        none = named_nothing(problem, found)
        by_catalogue = max(0.0, none.subset.rss - found.subset.rss)
        structure = by_catalogue + left.sum_of_squares
        if not found.found or by_catalogue < CATALOGUE_TOO_LITTLE * structure:
            alone = left_over(problem, (), seed + 11) or left
            if found.found and alone.p < LEFT_LEVEL:
                left = alone
            return none, "unexplained", (Unexplained(left.channel, left.variable, left.share),)
        if left.sum_of_squares > WORTH_SAYING * structure:
            return found, "unexplained", (Unexplained(left.channel, left.variable, left.share),)
    if not found.found:
        return found, "none", ()
    return found, "ambiguous" if any(one.rivals for one in found.found) else "named", ()


def _not_noise(problem: Problem, left: Left | None) -> Unexplained:
    """Structure that is no chance, though every name for it was refused."""
    if left is not None:
        return Unexplained(left.channel, left.variable, left.share)
    off = (problem.observed - problem.nominal) / problem.sd
    return Unexplained(problem.pieces[0].channel, "", max(0.0, 1.0 - 1.0 / max(1.0, float(np.mean(off ** 2)))))


def named_nothing(problem: Problem, found: Named) -> Named:
    """The same search, with nothing named."""
    space = space_of(problem)
    nothing = subset(space, [])
    assert nothing is not None
    return Named((), found.structure_p, nothing, space, nothing.dof, 1.0)


def _causes(problem: Problem, tables: Sequence[BenchTable], found: Named,
            clocks: Sequence[tuple[int, Clock]]) -> tuple[Cause, ...]:
    speed = _speed(tables)
    unsure = any(clock is not None and clock.p == UNDECIDED for clock in problem.clocks)
    causes = [_cause(problem, one, found.dof, speed, unsure) for one in found.found]
    if clocks:
        _, clock = min(clocks, key=lambda one: one[1].p)
        effect = CATALOGUE[CLOCK].effect
        causes.append(Cause(CLOCK, Size(clock.step_s, clock.low_s, clock.high_s, effect.unit), None, 1.0 - clock.p, (),
                            None, effect.advice, FieldCost(0.0, 0.0)))

    def weight(cause: Cause) -> float:
        return abs(cause.field_cost.rate_error_percent or 0.0) + 10.0 * abs(cause.field_cost.place_error_m or 0.0)

    return tuple(sorted(causes, key=weight, reverse=True))


def _cause(problem: Problem, one: Found, dof: float, speed: float | None, unsure: bool) -> Cause:
    choice, size = one.part
    effect = CATALOGUE[choice.id].effect
    half = float(student.ppf(0.95, dof)) * one.se
    rivals = tuple(Rival(r.choice.id, r.probability) for r in one.rivals)
    share = 1.0
    if unsure and choice.id in CONSTANT_TIMES:
        share = UNDECIDED
        rivals = (Rival(CLOCK, UNDECIDED), *(Rival(r.id, share * r.probability) for r in rivals))
    return Cause(choice.id, Size(size, size - half, size + half, effect.unit), None, share * one.probability, rivals,
                 choice.member, effect.advice,
                 field_cost(problem.machine, one.part, speed))


def _speed(tables: Sequence[BenchTable]) -> float | None:
    speeds = [s for table in tables if (s := table.speed_mps()) is not None]
    return float(np.nanmean(np.concatenate(speeds))) if speeds else None


def _channels(problem: Problem, found: Named) -> tuple[Channel, ...]:
    out = []
    for channel in dict.fromkeys(piece.channel for piece in problem.pieces):
        inside = [k for k, piece in enumerate(problem.pieces) if piece.channel == channel]
        rows = np.isin(problem.piece, inside)
        observed = np.concatenate([problem.pieces[k].observed for k in inside])
        off = observed - problem.nominal[rows]
        varies = float(np.sum((observed - observed.mean()) ** 2))
        explained = 1.0 - float(np.sum(off ** 2)) / varies if varies > 0.0 else 0.0
        out.append(Channel(channel, problem.pieces[inside[0]].unit, len(off), float(off.mean()),
                           float(np.sqrt(np.mean(off ** 2))), float(np.sqrt(np.mean(problem.sd[rows] ** 2))),
                           max(0.0, explained), min(1.0, found.structure_p)))
    return tuple(out)


def _findings(problem: Problem, tables: Sequence[BenchTable], made: Sequence[tuple[BenchTable, Piece]], found: Named,
              clocks: Sequence[tuple[int, Clock]], left: Left | None) -> tuple[str, ...]:
    out = [text for table in tables for text in table.findings]
    out += scatter_sentences(problem)
    out += label_sentences(problem, [table.label_column or "label" for table, _ in made])
    out += [clock_sentence(problem.pieces[index].name, clock) for index, clock in clocks]
    out += scope_sentences(problem, found)
    out += level_sentence(problem, found.parts, found.widened_by)
    if left is not None and left.p < LEFT_LEVEL and found.found:
        out.append(f"beside what is named, {left.channel} still depends on {left.variable} (p {left.p:.2g}, "
                   f"{100 * left.share:.0f} % of what is left)")
    if any(one.part.choice.id.startswith("place.") for one in found.found):
        out += list(dict.fromkeys(text for piece in problem.pieces for text in piece.remarks))
    if len(problem.observed) < 4:
        out.append(f"only {len(problem.observed)} rows: only large effects can be shown")
    return tuple(out)
