"""Answers that hang on no last bit: the same under every kernel of matrix products, and for
data moved by a hair."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from topdress.control.calibration.bench_table import BenchTable
from topdress.control.diagnosis.tables.table_series import find_first_best, sort_best_first

from tests.diagnosis import last_bits as bits
from tests.diagnosis.hidden.cases import one as hidden_case
from tests.diagnosis.logs import HUANGHAI
from tests.diagnosis.tables import SEVENS, lags, paper, responses, total_s

PAPERS = (
    "lag_table1_distance",
    "lag_table2_response",
    "lag_table3_drop_time",
    "lag_table4_total",
    "lag_table5_corrected",
    "lag_table6_gain",
    "decision_table2_applied",
)
# Cases of the examination of runs (seed 60231, those of test_hidden_quick): of every stage,
# healthy and beyond.
LOGS = (
    ("single", "shaft.gain", 5),
    ("single", "shaft.dead_time", 82),
    ("single", "shaft.voltage_sag", 160),
    ("single", "gate.offset", 322),
    ("single", "gate.backlash", 403),
    ("single", "gate.slow", 483),
    ("single", "flow.gain", 561),
    ("single", "flow.fill_falloff", 641),
    ("single", "flow.blocked_outlet", 800),
    ("single", "flow.leak", 882),
    ("single", "speed.wheel_slip", 960),
    ("single", "canopy.head_fouled", 1123),
    ("single", "scale.gain", 1161),
    ("single", "scale.drift", 1200),
    ("none", "", 2240),
    ("healthy_coarse", "", 1600),
    ("healthy_foreign", "", 1720),
    ("onset", "", 1841),
    ("pair", "", 2287),
    ("term", "memory", 1360),
)
SEED, MINUTES = 60231, (2.0, 3.0)  # length proves nothing here


def late_with_response(seed: int) -> list[BenchTable]:
    """A lag too long by a constant, and a response that is not: an offset of all lags, or a
    dead time of one table."""
    rng = np.random.default_rng(seed)
    late = lags(np.tile(SEVENS, 3), rng, 0.25)
    return [late, responses(np.repeat([10.0, 40.0, 70.0], 4), rng, 0.383, 0.004, "response")]


def printed(lag_s: np.ndarray, rpm: np.ndarray) -> list[BenchTable]:
    return [BenchTable("lag", {"shaft_rpm": rpm, "lag_s": lag_s})]


def made_tables() -> list[tuple[str, list[BenchTable]]]:
    """Tables in which names tie, and tables whose replicates are alike to the last digit."""
    cases = [(f"late and response {seed}", late_with_response(seed)) for seed in range(1, 7)]
    cases += [(f"late {seed}", late_with_response(seed)[:1]) for seed in (6, 10)]
    rpm = np.repeat(np.arange(10.0, 71.0, 10.0), 5)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        far = np.round(total_s(rpm) + 0.25 * (seed % 2), 2)
        far[rng.integers(0, len(rpm), 3)] += 0.4
        cases += [
            (
                f"tenths of a second {seed}",
                printed(np.round(total_s(rpm) + rng.normal(0.0, 0.02, 35), 1), rpm),
            ),
            (f"alike but for three rows {seed}", printed(far, rpm)),
            (f"all alike {seed}", printed(np.round(total_s(rpm), 2) + 0.1 * seed, rpm)),
        ]
    return cases


def papers_tables() -> list[tuple[str, list[BenchTable]]]:
    """Each of the papers' tables alone, the lag paper's two by two, and all of them together."""
    read = {name: paper(name) for name in PAPERS}
    lags = [name for name in PAPERS if name.startswith("lag")]
    return [
        *((name, [table]) for name, table in read.items()),
        *((f"{one} and {other}", [read[one], read[other]]) for one, other in combinations(lags, 2)),
        ("the lag paper", [read[name] for name in lags]),
    ]


def logs() -> list[tuple[str, dict[str, np.ndarray]]]:
    return [
        (
            f"{category} {name}",
            hidden_case(
                number, SEED, "tuning", (category,), ("run",), (name,) if name else (), MINUTES
            ).columns,
        )
        for category, name, number in LOGS
    ]


def test_of_equal_scores_the_first_is_best() -> None:
    assert find_first_best([1.0, 2.0, 2.0 * (1.0 + 1e-13)]) == 1
    assert find_first_best([1.0, 2.0, 2.1]) == 2
    assert find_first_best(-np.array([1e-300, 0.0, 3.0])) == 1
    assert sort_best_first([0.2, 0.4 * (1.0 - 1e-13), 0.4, np.inf]) == [3, 1, 2, 0]


@pytest.mark.exam
def test_tables_that_tie_are_answered_alike_by_two_kernels(tmp_path: Path) -> None:
    cases = made_tables()
    one, other = (bits.by_kernel(kernel, cases, tmp_path) for kernel in ("Prescott", "Haswell"))
    if one is None or other is None:
        pytest.skip("this processor has one of the two only")
    assert bits.differences(cases, one, other) == []


@pytest.mark.exam
def test_tables_moved_by_a_hair_are_answered_alike() -> None:
    # the others: the exam below
    cases = made_tables()[::2] + papers_tables()[: len(PAPERS) : 2]
    assert (
        bits.differences(
            cases,
            [bits.answer(case, HUANGHAI) for case in cases],
            [bits.answer(bits.moved(case, HUANGHAI), HUANGHAI) for case in cases],
        )
        == []
    )


@pytest.mark.exam
@pytest.mark.parametrize("data", ["tables", "logs"])
def test_every_kernel_gives_the_same_answers_and_so_does_data_moved_by_a_hair(
    tmp_path: Path, data: str
) -> None:
    cases = made_tables() + papers_tables() if data == "tables" else logs()[::2]
    said = {kernel: bits.by_kernel(kernel, cases, tmp_path) for kernel in bits.KERNELS}
    known = {kernel: answers for kernel, answers in said.items() if answers is not None}
    first = next(iter(known))
    wrong = {
        kernel: bits.differences(cases, known[first], answers) for kernel, answers in known.items()
    }
    hair = bits.by_kernel(first, [bits.moved(case, HUANGHAI) for case in cases], tmp_path)
    assert {**wrong, "moved": bits.differences(cases, known[first], hair)} == {
        **{k: [] for k in known},
        "moved": [],
    }
