"""The longest answers that a diagnosis looks for are those of a file and its log."""

from __future__ import annotations

import numpy as np
import pytest
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.result import Cause, Diagnosis, FieldCost, Size, SourceSummary
from topdress.control.diagnosis.runs.log import fit_answers_to_log
from topdress.control.machine.machine import Machine, add_effect

ALONE = Machine(stages=("shaft",))


def test_a_log_of_a_drive_alone_allows_answers_of_a_quarter_of_its_length() -> None:
    log = {"time_s": np.linspace(0.0, 4000.0, 400)}
    assert fit_answers_to_log(ALONE, log).limits.longest_answer_s == 1000.0
    assert fit_answers_to_log(Machine(), log) == Machine()
    with pytest.raises(ValueError, match="size 200"):
        add_effect(ALONE, "shaft.slow", 200.0)
    slow = Cause(
        "shaft.slow",
        Size(200.0, 190.0, 210.0, "s"),
        None,
        0.99,
        (),
        None,
        "Small and large steps.",
        FieldCost(0.0, 0.0),
    )
    data = SourceSummary("run.csv", "run", 600, 60.0, "heater")
    adopted = extend(ALONE, Diagnosis(data, (), "named", (slow,), (), (), None, (), None))
    assert adopted.shaft.slow_s == 200.0
    assert Machine.model_validate(adopted.model_dump()) == adopted
