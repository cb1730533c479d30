"""What a diagnosis changed in a machine file stands in its history, and the last of it can be taken back."""
from __future__ import annotations

from pathlib import Path

import pytest

from control.diagnosis.extend import extend
from control.diagnosis.result import Cause, Data, Diagnosis, FieldCost, Size, TermFound
from control.machine.history import last_change, undone
from control.machine.machine import Machine, effect_sizes, with_effect
from control.machine.terms import Term
from drivers.files.config import load, save
from drivers.files.kinds import MACHINE

TERM = Term.model_validate({"id": "flow.slope_roll_deg", "acts_on": "flow_percent", "form": "slope",
                            "over": ({"name": "roll_deg", "valid": (-4.0, 4.0)},), "coefficients": {"slope": -0.5}})


def found(size: float, *terms: Term) -> Diagnosis:
    cause = Cause("flow.gain", Size(size, size - 0.5, size + 0.5, "%"), None, 0.99, (), None, "Do a catch test.",
                  FieldCost(size, 0.0))
    told = tuple(TermFound(term.model_dump(mode="json"), "scale", "kg", 0.5, 0.1, 200.0, 0.8) for term in terms)
    return Diagnosis(Data("run.csv", "run", 600, 60.0, "huanghai"), (), "named", (cause,), (), (), None, (), None,
                     terms=told)


def test_the_last_change_is_taken_back_and_the_one_before_stays() -> None:
    start = Machine()
    first = extend(start, found(2.0), date="2026-07-01", sha256="1" * 64)
    second = extend(first, found(3.0, TERM), date="2026-07-09", sha256="2" * 64)
    assert (effect_sizes(second), [t.id for t in second.terms]) == ({"flow.gain": 5.0}, [TERM.id])
    back = undone(second, date="2026-07-10")
    assert back.model_copy(update={"history": ()}) == first.model_copy(update={"history": ()})
    assert [one.undone for one in back.history] == ["", "2026-07-10"]
    again = undone(back, date="2026-07-11")
    assert again.model_copy(update={"history": ()}) == start
    assert last_change(again) is None
    with pytest.raises(ValueError, match="nothing to take back"):
        undone(again)


def test_what_was_changed_by_hand_since_stays() -> None:
    changed = with_effect(extend(Machine(), found(2.0), date="2026-07-01"), "flow.gain", 2.5)
    assert effect_sizes(undone(changed)) == {"flow.gain": pytest.approx(0.5)}


def test_the_file_keeps_it(tmp_path: Path) -> None:
    extended = extend(Machine(), found(3.0, TERM), date="2026-07-09", sha256="2" * 64)
    save(tmp_path / "new.yaml", extended, MACHINE)
    read = load(str(tmp_path / "new.yaml"), MACHINE).model
    assert read == extended
    save(tmp_path / "back.yaml", undone(read, date="2026-07-10"), MACHINE)
    back = load(str(tmp_path / "back.yaml"), MACHINE).model
    assert (effect_sizes(back), back.terms, back.history[0].terms) == ({}, (), (TERM.model_copy(
        update={"source": back.history[0].terms[0].source}),))


def test_nothing_adopted_is_no_change() -> None:
    nothing = Diagnosis(Data("run.csv", "run", 600, 60.0, "huanghai"), (), "none", (), (), (), None, (), None)
    assert extend(Machine(), nothing) == Machine()
