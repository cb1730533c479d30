"""Drives far from their data sheet: names that are one curve, a drive that no name fits, and
what a file takes up."""

from __future__ import annotations

import json
import math
import random
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer
from topdress.console.app.pages.diagnosis import panel_views
from topdress.console.app.pages.diagnosis.adoption import find_offer, list_decided_ids
from topdress.console.app.pages.diagnosis.diagnosis_words import find_adopted_title
from topdress.console.app.pages.diagnosis.service import DiagnosisView
from topdress.console.cli.diagnose import adopt_findings
from topdress.console.services.diagnosis_job import DiagnosisOrder, carry_out_order
from topdress.control.diagnosis.extend import extend, find_cause_refusal
from topdress.control.diagnosis.prediction import plain_rival
from topdress.control.diagnosis.result import Cause, Diagnosis, Rival
from topdress.control.diagnosis.runs.adoption import select_adoptable
from topdress.control.diagnosis.runs.channels import make_channels
from topdress.control.diagnosis.runs.diagnose import diagnose_run, prepare_log
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.diagnosis.runs.search import Search
from topdress.control.machine.machine import Limits, Machine, list_effect_sizes
from topdress.control.machine.shaft import calc_time_constant_s
from topdress.drivers.files.config import load_config, save_config
from topdress.drivers.files.config_kinds import MACHINE_KIND
from topdress.drivers.files.plain_data import build_from_plain

from tests.diagnosis.logs import DRIVE, Columns, staircase, steps, wrong
from tests.diagnosis.planted import error_on


@pytest.fixture(scope="module")
def curve() -> Diagnosis:
    return diagnose_run(staircase(1), DRIVE)


@pytest.mark.exam
def test_a_gain_a_zone_and_a_curve_that_only_fit_together_are_named(curve: Diagnosis) -> None:
    assert {"shaft.gain", "shaft.dead_zone", "shaft.saturation"} <= {
        cause.id for cause in curve.causes
    }
    zone = next(cause for cause in curve.causes if cause.id == "shaft.dead_zone")
    assert zone.size.value == pytest.approx(110.0, abs=8.0)


def test_the_file_with_them_predicts_the_next_staircase(curve: Diagnosis) -> None:
    other = staircase(2)
    assert error_on(other, extend(DRIVE, curve)) < 0.1 * error_on(other, DRIVE)


@pytest.mark.exam
def test_a_drive_that_no_name_fits_is_adopted_as_a_whole() -> None:
    found, other = diagnose_run(steps(1), DRIVE), steps(2)
    assert found.fitted is not None
    assert found.fitted.after < 0.5 * found.fitted.before
    extended = extend(DRIVE, found)
    assert {one.id for one in extended.adopted} == {name for name, _ in found.fitted.sizes}
    assert error_on(other, extended) < 0.4 * error_on(other, DRIVE)
    assert "fitted" in found.to_json()


@pytest.mark.exam
def test_two_speeds_are_a_line_and_no_curve() -> None:
    """A zone and a gain pass through both speeds and go on straight; what bends beyond them
    nobody saw."""
    columns = steps(1)
    columns["shaft_rpm_cmd"] = np.where(columns["shaft_rpm_cmd"] > 330.0, 450.0, 250.0)
    found = diagnose_run(columns, DRIVE)
    assert found.fitted is None or "shaft.saturation" not in {
        name for name, _ in found.fitted.sizes
    }
    assert not any(one.predicts_best and one.term["form"] == "dead_zone" for one in found.terms)


def test_freedom_of_form_moves_no_size() -> None:
    columns = {name: np.asarray(values) for name, values in staircase(1).items()}
    _, data, _ = prepare_log(columns, DRIVE)
    search = Search([make_channels(data, DRIVE)["shaft"]], DRIVE, data)
    parts = (EffectInstance("shaft.gain", 100.0), EffectInstance("shaft.dead_zone", 90.0))
    slopes = search.columns.list_slopes(parts)
    for form in search.columns.list_shape_columns(parts, slopes):
        for slope in slopes:
            a, b = form.coefficients["shaft"], slope.coefficients["shaft"]
            assert abs(a @ b) < 1e-6 * np.linalg.norm(a) * np.linalg.norm(b) + 1e-9


def test_a_drive_may_be_quicker_than_its_data_sheet_and_never_ahead() -> None:
    assert calc_time_constant_s(DRIVE.shaft._replace(slow_s=-0.04)) == pytest.approx(0.02)
    assert calc_time_constant_s(DRIVE.shaft._replace(slow_s=-1.0)) > 0.0


def test_numbers_that_overflow_take_no_other_numbers_along(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fit(_log: Any, _channels: Any, file: Machine, _steps: int) -> Machine:
        if "shaft.neutral" in list_effect_sizes(file):
            raise ValueError("array must not contain infs or NaNs")
        return file

    monkeypatch.setattr(plain_rival, "fit_machine_file", fit)
    monkeypatch.setattr(plain_rival, "calc_errors_by_channel", lambda *_: {"shaft": np.ones(3)})
    monkeypatch.setattr(
        plain_rival,
        "_make_starting_machine",
        lambda machine, _drive, new, _share: wrong(dict.fromkeys(new, 5.0), machine),
    )
    on_log: Any = SimpleNamespace(data=SimpleNamespace(shaft=None))
    sets = [("shaft.gain",), ("shaft.gain", "shaft.neutral")]
    assert list(plain_rival._fit_parameter_sets(on_log, DRIVE, sets)) == sets[:1]


def eight_duties(seed: int) -> Columns:
    """A motor asked for eight duties by turns: it starts at 68 r/min of its command, lags it by
    30, ends at 283. Rows of 50 ms, its encoder counts 3.3 r/min."""
    draws, duty, speed_rpm, rows = random.Random(seed), 0, 0.0, []
    for k in range(2400):
        if k % 60 == 0:
            duty = draws.choice([0, 30, 60, 90, 120, 160, 200, 255])
        goal_rpm = 0.0 if duty < 45 else min(1.5 * (duty - 20), 1700.0 / 6.0)
        speed_rpm -= (goal_rpm - speed_rpm) * math.expm1(-0.05 / 0.15)
        rows.append((0.05 * k, 1.5 * duty, round((speed_rpm + draws.gauss(0.0, 1.0)) * 0.3) / 0.3))
    return dict(zip(("time_s", "shaft_rpm_cmd", "shaft_rpm"), np.array(rows).T, strict=True))


@pytest.mark.exam
def test_names_that_leave_something_are_adopted_together() -> None:
    """The judged curve bends where the motor ends, and a threshold is left: it predicts, its
    parts alone hardly do."""
    machine = DRIVE.model_copy(
        update={
            "shaft": DRIVE.shaft._replace(dead_time_s=0.0, time_constant_s=0.108, full_rpm=400.0),
            "limits": Limits(shaft_low_rpm=0.0, shaft_high_rpm=400.0),
        }
    )
    found = diagnose_run(eight_duties(1), machine)
    new = extend(
        machine,
        select_adoptable(
            found, [one.id for one in found.causes if not find_cause_refusal(one)]
        ).found,
    )
    assert error_on(eight_duties(2), new) < 0.5 * error_on(eight_duties(2), machine)


# --- What a machine file takes up of a joint fit: all of it, or what is left of it fitted anew;
# never what is worse --

LOG = "stairs.csv"


def with_rival(cause: Cause) -> Cause:
    return replace(cause, probability=0.6, rivals=(Rival("shaft.dead_band", 0.4),))


@pytest.mark.parametrize("name", ["shaft.gain", "shaft.dead_zone", "shaft.saturation"])
def test_a_file_without_an_undecided_part_of_a_curve_is_never_worse(
    curve: Diagnosis, name: str, tmp_path: Path
) -> None:
    undecided = replace(
        curve, causes=tuple(with_rival(one) if one.id == name else one for one in curve.causes)
    )
    (tmp_path / LOG).write_text("time_s\n")
    out = tmp_path / "new.yaml"
    try:
        adopt_findings(undecided, DRIVE, [tmp_path / LOG], out)
    except typer.Exit:
        # nothing is written: the machine file stays as it is
        return
    new = load_config(str(out), MACHINE_KIND).model
    for seed in (1, 2):
        assert error_on(staircase(seed), new) < error_on(staircase(seed), DRIVE)


def test_what_is_left_of_a_joint_fit_is_fitted_anew(curve: Diagnosis) -> None:
    """A staircase without its bend: gain and zone fit on their own, at other sizes than with it."""
    taken = select_adoptable(curve, ["shaft.gain", "shaft.dead_zone"])
    assert [one.id for one in taken.found.causes] == [
        "shaft.gain",
        "shaft.dead_zone",
    ] or taken.refused
    sizes = {one.id: one.size.value for one in curve.causes}
    for one in taken.found.causes:
        assert one.size.value != pytest.approx(sizes[one.id], rel=0.05)
    new = extend(DRIVE, taken.found)
    assert error_on(staircase(2), new) <= error_on(staircase(2), DRIVE)


def test_what_is_whole_is_taken_up_as_it_is(curve: Diagnosis) -> None:
    taken = select_adoptable(curve, [one.id for one in curve.causes])
    assert taken.found.causes == curve.causes and not taken.refused


@pytest.mark.exam
def test_the_page_offers_a_drive_as_a_whole_as_the_command_line_does(tmp_path: Path) -> None:
    log, machine = tmp_path / "steps.csv", tmp_path / "drive.yaml"
    columns = steps(1)
    rows = zip(*(columns[name] for name in ("time_s", "shaft_rpm_cmd", "shaft_rpm")), strict=True)
    log.write_text(
        "time_s,shaft_rpm_cmd,shaft_rpm\n"
        + "".join(f"{t:.3f},{a:.2f},{r:.2f}\n" for t, a, r in rows)
    )
    save_config(machine, DRIVE, MACHINE_KIND)
    carry_out_order(
        DiagnosisOrder(str(log), str(tmp_path), machine=str(machine)), lambda share, stage: None
    )
    found = build_from_plain(DiagnosisView, json.loads((tmp_path / "view.json").read_text()))
    assert found.found.fitted is not None and found.adoptable == ("shaft as a whole",)
    offer = find_offer(found, list_decided_ids(found))
    assert offer is not None and offer.changes
    new = load_config(str(tmp_path / offer.file), MACHINE_KIND).model
    assert error_on(steps(2), new) < 0.6 * error_on(steps(2), DRIVE)
    assert "shaft as a whole: Shaft" in find_adopted_title(found, found.adoptable[0])
    assert "as a whole" in " ".join(panel_views.make_channels_view(found).gains)


@pytest.mark.exam
def test_steps_of_an_encoder_do_not_keep_a_drive_from_being_fitted_as_a_whole() -> None:
    """Readings in steps of 16 r/min hide what a slope says of a lag; what all rows say of it
    they do not hide."""
    columns, other = steps(1), steps(2)
    for one in (columns, other):
        one["shaft_rpm"] = 16.0 * np.round(one["shaft_rpm"] / 16.0)
    found = diagnose_run(columns, DRIVE)
    assert found.fitted is not None and {"shaft.slow", "shaft.dead_time"} & {
        name for name, _ in found.fitted.sizes
    }
    assert error_on(other, extend(DRIVE, found)) < 0.6 * error_on(other, DRIVE)
