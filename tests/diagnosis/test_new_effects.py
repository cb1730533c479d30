"""An effect that came after the examination's timetable is named in a run of the product's own
simulation, and in a run of the hidden generator.

The cases of the timetable stay as they are, so that their published figures can be compared."""

from __future__ import annotations

import datetime as dt
from typing import Any

import numpy as np
import pytest
from topdress.console.cli import app
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.run_setup import load_setup

from tests.diagnosis.hidden.nominal import IDS
from tests.diagnosis.hidden.programmes import PROGRAMMES

pytestmark = pytest.mark.exam
# An older effect is asked beside the new effects, so that the tests themselves are seen to work.
NAMED = ("shaft.voltage_sag", *(name for name, kind in IDS.items() if kind.is_new))
# Detectability of the hidden effect: it can be named beyond doubt.
WANTED_Z = 25.0


def check_named(found: Diagnosis, name: str, size: float) -> None:
    assert [cause.id for cause in found.causes] == [name], (found.verdict, found.unexplained)
    (cause,) = found.causes
    assert cause.probability >= 0.9
    assert cause.size.value == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize("name", NAMED)
def test_new_effect_is_named_in_the_simulation(name: str, tmp_path: Any) -> None:
    size = EFFECT_ROWS[name].usual
    log = str(tmp_path / "run.csv")
    effect = f"{name}={size:g}"
    words = ["simulate", "--seconds", "1800", "--seed", "1", "--effect", effect, "--out", log]
    app(words, standalone_mode=False)
    machine = load_setup("huanghai", "demo", dt.date(2026, 1, 1)).machine
    check_named(diagnose_run(read_log(log), machine), name, size)


@pytest.mark.parametrize("name", NAMED)
def test_new_effect_is_named_in_a_hidden_machine(name: str, hidden: Any) -> None:
    programme = next(p for p in PROGRAMMES if p.name == "grid_long")
    plant = hidden.plant.Plant(hidden.programmes.drive(programme._replace(minutes=(10.0, 10.0)), 4))
    noises = hidden.noise.noises("ar1", plant.drive.row_s, np.random.default_rng(2))
    eye = hidden.detect.Eye(plant, noises, hidden.nominal.Physics())
    made = hidden.run_cases.sized(
        eye, hidden.nominal.Effect(name, IDS[name].guess), WANTED_Z, IDS[name].most
    )
    assert made is not None, "no size of it shows so well"
    columns = hidden.runlog.columns(plant, hidden.nominal.Physics(), (made[0],), noises, 9)
    machine = load_setup("huanghai", "demo", dt.date(2026, 1, 1)).machine
    check_named(diagnose_run(columns, machine), name, made[0].size)
