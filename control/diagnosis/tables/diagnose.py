"""Diagnoses bench tables: shows errors, names their causes, lists alternatives, measures the gain,
plans the next test.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from topdress.control.calibration.bench_table import BenchTable, select_usable_rows
from topdress.control.diagnosis.result import Diagnosis, SourceSummary
from topdress.control.machine.machine import Machine

from .duplicate_rows import remove_duplicates
from .held_out_gain import calc_held_out_gain, list_detectable_sizes, list_effects_not_shown
from .problem import make_problem
from .report import (
    find_next_run,
    find_verdict,
    list_causes,
    list_channels,
    list_findings,
    plan_rate_change,
)
from .search import search_table_models
from .table_rows import make_table_pieces
from .verdict import judge_table_search

Progress = Callable[[float, str], None]


def diagnose_tables(
    tables: Sequence[BenchTable],
    machine: Machine,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose bench tables: find the errors of the machine model, their causes, and the gain of
    correcting them.

    Parameters
    ----------
    tables
        One bench table, or several of the same machine together, which may complement each other.
        Columns are float64 arrays of shape (rows,) with their units in their names
        (docs/bench-tables.md); NaN means a missing value.
    machine
        The machine of the machine file. Its tolerances are priors; found sizes are added to its own
        effects.
    seed
        Seed of the draws for the intervals of the gain; the same seed gives the same diagnosis.
    progress
        `progress(share, what)` is called between stages, share from 0 to 1; an exception from it
        cancels the diagnosis.

    Returns
    -------
    Diagnosis
        By the contract "topdress-diagnosis/1". Sizes and their 90 % intervals are in the
        catalogue's units (`topdress effects`), residuals in those of the column: s, kg, NDVI or
        m. Field costs are in % and m.

    Raises
    ------
    ValueError
        One line, for no table, a table given twice, an unknown kind, a missing column, a number
        out of range, or a table without a usable row.

    Notes
    -----
    Noise is estimated from replicates (pure error), with winsorised outliers [1]_; unequal scatter
    is tested by Brown and Forsythe [2]_. Every set of up to three effects, with and without an
    unknown dependence, has a log evidence and prior odds [3]_ (control/diagnosis/judgement); the
    report contains what the probable sets have in common. The cosine quantogram finds steps in
    times [4]_. The gain is measured on settings left out one at a time.

    References
    ----------
    .. [1] Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993. .. [2] Brown and Forsythe,
    J. Am. Stat. Assoc. 69, 1974. .. [3] Kass and Raftery, Bayes factors, J. Am. Stat. Assoc. 90,
    1995. .. [4] D. G. Kendall, Hunting quanta, Phil. Trans. R. Soc. A 276, 1974.

    Examples
    --------
    A catch test that yields 6 % more than the machine file predicts, at three shaft speeds and two
    openings:

    >>> import numpy as np
    >>> from topdress.control.calibration.bench_table import BenchTable
    >>> from topdress.control.machine.machine import Machine
    >>> shaft_rpm = np.repeat([20.0, 50.0, 80.0], 4)
    >>> opening_mm = np.tile([10.0, 10.0, 30.0, 30.0], 3)
    >>> scatter = 0.004 * np.random.default_rng(1).standard_normal(12)
    >>> mass_kg = 1.06 * 5.5e-3 * opening_mm * shaft_rpm / 60.0 * 30.0 * (1.0 + scatter)
    >>> columns = {"shaft_rpm": shaft_rpm, "opening_mm": opening_mm, "mass_kg": mass_kg}
    >>> table = BenchTable("catch", columns | {"duration_s": np.full(12, 30.0)})
    >>> found = diagnose_tables([table], Machine())
    >>> found.verdict, [(one.id, round(one.size.value), one.size.unit) for one in found.causes]
    ('named', [('flow.gain', 6, '%')])
    >>> found.gain[0].after < 0.3 * found.gain[0].before
    True
    """
    if not tables:
        raise ValueError("no table given: at least one is needed")
    tell = progress or (lambda share, what: None)
    tables = [select_usable_rows(table) for table in tables]
    _refuse_twins(tables)
    once = remove_duplicates(tables, machine)
    pieces = [piece for table in once.tables for piece in make_table_pieces(table, machine)]
    tell(0.1, "noise and steps in the times")
    problem = make_problem(pieces, machine, seed + 20)
    tell(0.2, "search")
    found = search_table_models(problem)
    tell(0.6, "verdict")
    smallest = list_detectable_sizes(found)
    judgement = judge_table_search(found, bool(smallest))
    causes = list_causes(problem, tables, judgement)
    shown = frozenset([*(c.id for c in causes), *(r.id for c in causes for r in c.rivals)])
    tell(0.7, "gain")
    return Diagnosis(
        data=SourceSummary(
            " + ".join(table.path for table in tables),
            "+".join(dict.fromkeys(t.kind for t in tables)),
            sum(table.rows for table in tables),
            None,
            machine.id,
        ),
        channels=list_channels(problem, judgement.nothing),
        verdict=find_verdict(judgement, causes),
        causes=causes,
        not_shown=list_effects_not_shown(smallest, shown, machine),
        unexplained=judgement.unexplained,
        next_run=find_next_run(problem, judgement) or plan_rate_change(tables, machine),
        gain=calc_held_out_gain(found, judgement.effects, seed),
        extended_machine=None,
        findings=list_findings(problem, tables, judgement, once.retellings),
    )


def _refuse_twins(tables: Sequence[BenchTable]) -> None:
    paths = [table.path for table in tables if table.path]
    for path in paths:
        if paths.count(path) > 1:
            raise ValueError(f"{path}: given twice: each table once")
