"""Ten machines with something that no list holds, two logs each: what is said, and whether the
file predicts better.

pytest -m exam -s tests/diagnosis/test_unlisted.py      # prints the table
"""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from topdress.console.reports.diagnosis_wording import is_undecided
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.judgement.prior import MIN_NAMED_PROB
from topdress.control.diagnosis.runs.adoption import select_adoptable
from topdress.control.diagnosis.runs.compared import compared
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

FIRST, SECOND = "grid_long", "scatter_long"  # both move shaft and gate over their ranges
MINUTES = (14.0, 15.0)
WRONG_NAMES = 1  # of ten machines, at most


class Answer(NamedTuple):
    """Of one machine. found : whether anything is said, be it that a sensor is louder than its
    file. wrong : names said for sure that are no fair answer. worse : channels of the second
    log that the adopted file predicts worse than the data sheet, with both errors."""

    verdict: str
    found: bool
    wrong: list[str]
    adopted: list[str]
    worse: list[str]


@pytest.fixture(scope="module")
def answers(hidden: SimpleNamespace) -> Iterator[dict[str, Answer]]:
    found = {name: _answer(hidden, name, k) for k, name in enumerate(hidden.unlisted.MACHINES)}
    for name, one in found.items():
        print(
            f"\n{name:18s} {one.verdict:12s} wrong: {', '.join(one.wrong) or '-'}; adopted: "
            f"{', '.join(one.adopted) or '-'}; worse: {', '.join(one.worse) or '-'}",
            end="",
        )
    yield found


def _answer(hidden: SimpleNamespace, name: str, seed: int) -> Answer:
    machine = load_config("huanghai", MACHINE_KIND).model
    first, second = (
        _log(hidden, name, programme, seed, k) for k, programme in enumerate((FIRST, SECOND))
    )
    found = diagnose_run(first, machine, path="log.csv")
    said = found.verdict != "none" or bool(found.findings)
    fair = hidden.unlisted.MACHINES[name]
    wrong = [
        one.id
        for one in found.causes
        if one.probability >= MIN_NAMED_PROB and not one.rivals and one.id not in fair
    ]
    taken = select_adoptable(found, [one.id for one in found.causes if not is_undecided(one)]).found
    names = [*(one.id for one in taken.causes), *(one.term["id"] for one in taken.terms)]
    if not names and taken.fitted is None:
        return Answer(found.verdict, said, wrong, [], [])
    worse = [
        f"{one.channel} {one.old:.3g} -> {one.new:.3g}"
        for one in compared(second, machine, extend(machine, taken)).channels
        if one.new > one.old
    ]
    return Answer(found.verdict, said, wrong, names or ["fitted"], worse)


def _log(
    hidden: SimpleNamespace, name: str, programme: str, seed: int, k: int
) -> dict[str, np.ndarray]:
    driven = next(one for one in hidden.programmes.PROGRAMMES if one.name == programme)
    drive = hidden.programmes.drive(driven._replace(minutes=MINUTES), 100 * seed + k)
    plant = hidden.unlisted.Unlisted(drive, name, seed)
    noises = hidden.noise.noises("ar1", plant.drive.row_s, np.random.default_rng([seed, k]))
    physics = hidden.run_cases.within_tolerance(np.random.default_rng(seed), refill=False)
    return hidden.runlog.columns(plant, physics, (), noises, 1000 + 10 * seed + k)


@pytest.mark.exam
def test_no_machine_passes_in_silence(answers: dict[str, Answer]) -> None:
    assert [name for name, one in answers.items() if not one.found] == []


@pytest.mark.exam
def test_hardly_a_wrong_name_is_said_for_sure(answers: dict[str, Answer]) -> None:
    assert sum(bool(one.wrong) for one in answers.values()) <= WRONG_NAMES


@pytest.mark.exam
def test_no_file_predicts_the_next_log_worse(answers: dict[str, Answer]) -> None:
    assert {name: one.worse for name, one in answers.items() if one.worse} == {}
