"""What a machine file takes up of a joint fit: all of it, or what is left of it fitted anew; never what is worse."""
from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer

from console.app.pages.diagnosis.adoption import offer_of, sure
from console.app.pages.diagnosis.service import DiagnosisView
from console.app.pages.diagnosis.shown import channels
from console.app.pages.diagnosis.words import adopted_title
from console.cli.adopting import adopt
from console.services.diagnosis_job import Order, work
from control.diagnosis.extend import extend
from control.diagnosis.result import Cause, Diagnosis, Rival
from control.diagnosis.runs.adoption import adoptable_of
from control.diagnosis.runs.diagnose import diagnose_run
from drivers.files.config import load, save
from drivers.files.kinds import MACHINE
from drivers.files.plain import typed
from tests.diagnosis.logs import DRIVE, staircase, steps
from tests.diagnosis.planted import error_on

LOG = "stairs.csv"


@pytest.fixture(scope="module")
def curve() -> Diagnosis:
    """Gain, dead zone and saturation, fitted together."""
    return diagnose_run(staircase(1), DRIVE)


def with_rival(cause: Cause) -> Cause:
    return replace(cause, probability=0.6, rivals=(Rival("shaft.dead_band", 0.4),))


@pytest.mark.parametrize("name", ["shaft.gain", "shaft.dead_zone", "shaft.saturation"])
def test_a_file_without_an_undecided_part_of_a_curve_is_never_worse(curve: Diagnosis, name: str, tmp_path: Path
                                                                    ) -> None:
    undecided = replace(curve, causes=tuple(with_rival(one) if one.id == name else one for one in curve.causes))
    (tmp_path / LOG).write_text("time_s\n")
    out = tmp_path / "new.yaml"
    try:
        adopt(undecided, DRIVE, [tmp_path / LOG], out)
    except typer.Exit:
        return                      # nothing is written: the machine file stays as it is
    new = load(str(out), MACHINE).model
    for seed in (1, 2):
        assert error_on(staircase(seed), new) < error_on(staircase(seed), DRIVE)


def test_what_is_left_of_a_joint_fit_is_fitted_anew(curve: Diagnosis) -> None:
    """A staircase without its bend: gain and zone fit on their own, at other sizes than with it."""
    taken = adoptable_of(curve, ["shaft.gain", "shaft.dead_zone"])
    assert [one.id for one in taken.found.causes] == ["shaft.gain", "shaft.dead_zone"] or taken.refused
    sizes = {one.id: one.size.value for one in curve.causes}
    for one in taken.found.causes:
        assert one.size.value != pytest.approx(sizes[one.id], rel=0.05)
    new = extend(DRIVE, taken.found)
    assert error_on(staircase(2), new) <= error_on(staircase(2), DRIVE)


def test_what_is_whole_is_taken_up_as_it_is(curve: Diagnosis) -> None:
    taken = adoptable_of(curve, [one.id for one in curve.causes])
    assert taken.found.causes == curve.causes and not taken.refused


def test_the_page_offers_a_drive_as_a_whole_as_the_command_line_does(tmp_path: Path) -> None:
    log, machine = tmp_path / "steps.csv", tmp_path / "drive.yaml"
    columns = steps(1)
    rows = zip(*(columns[name] for name in ("time_s", "shaft_rpm_cmd", "shaft_rpm")), strict=True)
    log.write_text("time_s,shaft_rpm_cmd,shaft_rpm\n" + "".join(f"{t:.3f},{a:.2f},{r:.2f}\n" for t, a, r in rows))
    save(machine, DRIVE, MACHINE)
    work(Order(str(log), str(tmp_path), machine=str(machine)), lambda share, stage: None)
    found = typed(DiagnosisView, json.loads((tmp_path / "view.json").read_text()))
    assert found.found.fitted is not None and found.adoptable == ("shaft as a whole",)
    offer = offer_of(found, sure(found))
    assert offer is not None and offer.changes
    new = load(str(tmp_path / offer.file), MACHINE).model
    assert error_on(steps(2), new) < 0.6 * error_on(steps(2), DRIVE)
    assert "shaft as a whole: Shaft" in adopted_title(found, found.adoptable[0])
    assert "as a whole" in " ".join(channels(found).gains)


def test_steps_of_an_encoder_do_not_keep_a_drive_from_being_fitted_as_a_whole() -> None:
    """Readings in steps of 16 r/min hide what a slope says of a lag; what all rows say of it they do not hide."""
    columns, other = steps(1), steps(2)
    for one in (columns, other):
        one["shaft_rpm"] = 16.0 * np.round(one["shaft_rpm"] / 16.0)
    found = diagnose_run(columns, DRIVE)
    assert found.fitted is not None and {"shaft.slow", "shaft.dead_time"} & {name for name, _ in found.fitted.sizes}
    assert error_on(other, extend(DRIVE, found)) < 0.6 * error_on(other, DRIVE)
