"""The Diagnosis page's files and processes: lists, one real diagnosis, cancel, adopt, export,
the separating run."""

from __future__ import annotations

import datetime as dt
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from topdress.console.app.pages.diagnosis.adoption import list_selections, list_undecided
from topdress.console.app.pages.diagnosis.service import Adoption, StopSignal, WorkStopped
from topdress.console.reports.diagnosis_wording import sort_adoptable
from topdress.console.services import diagnosis
from topdress.console.services.diagnosis import DiagnosisFiles
from topdress.console.services.separating_run import _DRIVE_MAKERS, is_drivable, make_drive
from topdress.control.diagnosis.extend import list_adoptable_causes
from topdress.control.diagnosis.result import (
    Cause,
    Diagnosis,
    FieldCost,
    Rival,
    Size,
    SourceSummary,
)
from topdress.control.experiments.manoeuvres import list_manoeuvres
from topdress.control.orders import State
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import simulate_run
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import JOB_KIND, MACHINE_KIND
from topdress.drivers.files.run_setup import load_setup

from tests.app.made_up.diagnosis import having, sample_found

CATCH = "shaft_rpm,opening_mm,duration_s,mass_kg\n" + "".join(
    f"{rpm},{mm},60,{1.06 * 5.5e-3 * rpm * mm * (1.0 + 0.002 * (-1) ** k):.4f}\n"
    for k, (rpm, mm) in enumerate(
        (rpm, mm) for rpm in (20, 40, 60, 80) for mm in (10, 20, 30) for _twice in (1, 2)
    )
)


@pytest.fixture
def folder(tmp_path):
    here = tmp_path / "data"
    here.mkdir()
    (here / "catch.csv").write_text(CATCH, encoding="utf-8")
    (here / "run.csv").write_text("time_s,shaft_rpm\n0.0,1\n0.05,2\n", encoding="utf-8")
    (here / "run.truth.csv").write_text("time_s,flow_kg_s\n0,1\n", encoding="utf-8")
    (here / "notes.md").write_text("eggs,milk\n6,1\n", encoding="utf-8")
    os.utime(here / "catch.csv", (1_700_000_000, 1_700_000_000))
    return here


@pytest.fixture
def files(folder, tmp_path):
    return DiagnosisFiles([folder], own=tmp_path / "own")


def test_what_can_be_diagnosed_is_listed_newest_first(files, folder):
    found = files.list_sources(str(folder / "run.csv"))
    assert [(one.name, one.kind, one.working) for one in found] == [
        ("run.csv", "run", True),
        ("catch.csv", "catch", False),
    ]
    assert found[1].size == "0.4 kB" and found[1].changed.startswith("2023-11-1")


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("", "no file is named"),
        ("none.csv", "No such file"),
        ("notes.md", "neither a run log"),
        (".", "neither a run log"),
    ],
)
def test_a_typed_path_that_will_not_do_is_refused_in_one_line(files, folder, path, said):
    with pytest.raises(ValueError, match=said) as caught:
        files.find_source(str(folder / path) if path else path)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def caught(tmp_path_factory):
    """A catch test with 6 % more per revolution, diagnosed by the real process."""
    here = tmp_path_factory.mktemp("caught")
    (here / "catch.csv").write_text(CATCH, encoding="utf-8")
    service = DiagnosisFiles([here], own=here / "own")
    told: list[tuple[float, str]] = []
    found = service.run_diagnosis(
        service.find_source(str(here / "catch.csv")),
        None,
        lambda *said: told.append(said),
        StopSignal(),
    )
    return service, found, told


def test_a_catch_test_is_diagnosed_by_a_process_of_its_own(caught):
    _service, found, told = caught
    data = found.found.data
    assert (data.kind, data.rows, data.machine) == ("catch", 24, "huanghai")
    gain, over = next(
        (cause, drawn.over)
        for cause, drawn in zip(found.found.causes, found.drawn, strict=True)
        if cause.id == "flow.gain"
    )
    assert gain.size.value == pytest.approx(6.0, abs=0.5) and over is not None
    assert np.abs(over.after).max() < np.abs(over.before).max()
    shares = [share for share, _stage in told]
    assert shares == sorted(shares) and {"reading", "search", "report"} <= {
        stage for _share, stage in told
    }


def test_adopting_writes_a_new_machine_with_its_provenance_and_overwrites_nothing(caught):
    service, found, _told = caught
    paths = [Path(service.adopt_effects(found, Adoption(found.adoptable))) for _twice in (1, 2)]
    assert paths[0] != paths[1] and paths[0].parent == service.own / "machines"
    machine = load_config(paths[0], MACHINE_KIND).model
    assert machine.flow.gain_percent == pytest.approx(6.0, abs=0.5)
    adopted = next(one for one in machine.adopted if one.id == "flow.gain")
    assert adopted.data.endswith("catch.csv") and len(adopted.sha256) == 64 and adopted.date
    assert "diagnosis of catch.csv" in paths[0].read_text(encoding="utf-8")
    assert str(paths[0]) in service.list_machines()


def test_a_choice_between_tied_causes_is_kept_with_its_reason(caught):
    service, found, _told = caught
    first, *more = found.found.causes
    tied = having(found, causes=(replace(first, rivals=(Rival("scale.gain", 0.3),)), *more))
    path = Path(
        service.adopt_effects(tied, Adoption(found.adoptable, "outlets were\nweighed twice"))
    )
    text = path.read_text(encoding="utf-8")
    assert f"The operator picked: {first.id}. Why: outlets were weighed twice" in text
    assert f"Not decided by the data: {first.id}; scale.gain" in text
    assert load_config(path, MACHINE_KIND).model.adopted


def test_there_is_a_machine_file_for_each_choice_and_none_for_nothing(caught):
    service, found, _told = caught
    assert [offer.ids for offer in found.offers] == [found.adoptable], "all of it is decided"
    assert found.offers[0].changes and (Path(found.folder) / found.offers[0].file).exists()
    with pytest.raises(ValueError, match="pick one of them at a time"):
        service.adopt_effects(found, Adoption(()))


def test_of_undecided_causes_any_may_be_picked_and_of_many_one_at_a_time():
    first, second = sample_found().found.causes
    open_ = tuple(replace(first, id=f"flow.{number}") for number in range(6))
    found = having(
        sample_found()._replace(adoptable=("flow.0", "flow.1", "shaft.voltage_sag")),
        causes=(*open_[:2], second),
    )
    assert list(list_selections(found)) == [
        ("shaft.voltage_sag",),
        ("flow.0", "shaft.voltage_sag"),
        ("flow.1", "shaft.voltage_sag"),
        ("flow.0", "flow.1", "shaft.voltage_sag"),
    ]
    many = having(found._replace(adoptable=tuple(one.id for one in open_)), causes=open_)
    assert list(list_selections(many)) == [(one.id,) for one in open_], (
        "nothing alone makes no file"
    )
    suspected = replace(open_[0], rivals=(), probability=0.4)
    assert list_undecided(having(found, causes=(suspected,))) == (suspected,)


def test_report_and_data_are_exported(caught):
    service, found, _told = caught
    report, data = (
        Path(service.export_result(found, "report")),
        Path(service.export_result(found, "data")),
    )
    assert "<!DOCTYPE html>" in report.read_text(encoding="utf-8")
    assert yaml.safe_load(data.read_text(encoding="utf-8"))["format"] == "topdress-diagnosis/1"


def test_what_has_no_driven_run_says_so(caught):
    service, found, _told = caught
    for ask in (
        service.write_separating_job,
        lambda found: service.drive_separating_run(found, lambda *_: None, StopSignal()),
    ):
        with pytest.raises(ValueError, match="this run"):
            ask(having(found._replace(drives=""), next_run=None))


@pytest.mark.exam
def test_data_that_cannot_be_used_is_one_line(files, folder):
    with pytest.raises(ValueError) as caught:
        files.run_diagnosis(
            files.find_source(str(folder / "run.csv")), None, lambda *_: None, StopSignal()
        )
    assert (
        str(caught.value).strip()
        and "\n" not in str(caught.value)
        and "Traceback" not in str(caught.value)
    )


def test_cancelling_ends_the_process_at_once(files, folder):
    def used_s() -> float:  # processor's time of processes that have ended
        return os.times().children_user + os.times().children_system

    stop, begun_s = StopSignal(), used_s()
    with pytest.raises(WorkStopped):
        files.run_diagnosis(
            files.find_source(str(folder / "catch.csv")),
            None,
            lambda share, stage: stop.set(),
            stop,
        )
    already = StopSignal()
    already.set()
    with pytest.raises(WorkStopped):
        files.run_diagnosis(
            files.find_source(str(folder / "catch.csv")), None, lambda *_: None, already
        )
    assert used_s() - begun_s < 3.0


# --- what may be adopted
# ---------------------------------------------------------------------------------------------


def cause(
    effect_id: str,
    value: float | None = 5.0,
    onset_s: float | None = None,
    scope: str | None = None,
    until_s: float | None = None,
    grows: bool = False,
) -> Cause:
    return Cause(
        effect_id,
        Size(value, None, None, "%"),
        onset_s,
        0.9,
        (),
        None,
        "",
        FieldCost(None, None),
        scope,
        until_s,
        grows,
    )


def test_scoped_late_and_sizeless_effects_are_refused():
    found = Diagnosis(
        SourceSummary("t.csv", "lag", 9, None, "m"),
        (),
        "named",
        (
            cause("lag.offset", scope="t.csv after"),
            cause("flow.gain"),
            cause("shaft.stall", 100.0),
            cause("scale.gain", None),
            cause("shaft.gain", onset_s=60.0),
            cause("gate.offset", until_s=60.0),
            cause("gate.gain", grows=True),
        ),
        (),
        (),
        None,
        (),
        None,
    )
    kept, refused = sort_adoptable(found)
    assert kept == ("flow.gain",)
    assert [why.split(":")[0] for why in refused] == [
        "lag.offset",
        "shaft.stall",
        "scale.gain",
        "shaft.gain",
        "gate.offset",
        "gate.gain",
    ]
    assert "ended during the run" in refused[4] and "grew during the run" in refused[5]
    assert [one.id for one in list_adoptable_causes(found)] == ["lag.offset", "flow.gain"]
    assert "holds in the rows of t.csv after only" in refused[0] and "during the run" in refused[1]


# --- the separating run
# ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def huanghai():
    return load_config("huanghai", MACHINE_KIND).model


def test_every_planned_manoeuvre_can_be_driven(huanghai):
    assert {one.id for one in list_manoeuvres(huanghai) if is_drivable(one.id)} == set(
        _DRIVE_MAKERS
    )
    assert not is_drivable("") and not is_drivable("weigh_by_hand")


@pytest.mark.parametrize(
    ("manoeuvre", "column", "wanted"),
    [
        ("stairs", "shaft_rpm", {20.0, 40.0, 60.0, 80.0}),
        pytest.param("openings", "opening_mm", {10.0, 20.0, 30.0, 40.0}, marks=pytest.mark.exam),
    ],
)
@pytest.mark.exam
def test_staircases_are_driven_standing_a_minute_each_step(huanghai, manoeuvre, column, wanted):
    setup = load_setup("huanghai", "demo", dt.date.today())
    drive = make_drive(manoeuvre, setup.job, huanghai)
    job = add_simulated_field(drive.job, huanghai)
    step_s = 0.1
    plant = make_plant(huanghai, job, 1, step_s)
    loop = make_control_loop(huanghai, setup.crop, setup.rule, job)
    rows = [step.tick.row for step in simulate_run(plant, loop, drive.seconds, orders=drive.orders)]
    assert max(row.speed_mps or 0.0 for row in rows) < 0.2
    busy = [
        row for row in rows if row.state == State.CALIBRATING and (row.shaft_rpm_cmd or 0.0) > 0.0
    ]
    spent = {
        place: step_s
        * sum(abs((getattr(row, f"{column}_cmd") or 0.0) - place) < 2.0 for row in busy)
        for place in wanted
    }
    assert all(100.0 < seconds <= 120.0 for seconds in spent.values()), spent


def test_the_job_file_of_a_separating_run_reads_back(files, tmp_path, huanghai):
    found = sample_found()
    slope = next(one for one in list_manoeuvres(huanghai) if one.id == "slope")
    on_slope = having(
        found._replace(drives="slope"), next_run=replace(found.found.next_run, plan=slope.plan)
    )
    path = Path(files.write_separating_job(on_slope))
    job = load_config(path, JOB_KIND).model
    assert job.simulated.slope_deg == 4.0 and not job.flow_trim and job.title == slope.plan
    stairs = Path(files.write_separating_job(found)).read_text(encoding="utf-8")
    assert "are the operator's to set" in stairs


@pytest.mark.exam
def test_an_adopted_file_is_compared_before_and_after_on_another_log(tmp_path):
    """By the real process: a drive that turns 5 % faster, and a file that took that up."""
    from topdress.control.machine.history import append_history
    from topdress.control.machine.machine import add_effect
    from topdress.drivers.files.config import save_config

    rng, time_s = np.random.default_rng(1), np.arange(0.0, 120.0, 0.02)
    command = np.repeat(rng.uniform(100.0, 600.0, 60).round(), 100)
    read = 1.05 * np.concatenate((command[:10], command[:-10])) + 2.0 * rng.standard_normal(
        len(time_s)
    )
    log = tmp_path / "other.csv"
    log.write_text(
        "time_s,shaft_rpm_cmd,shaft_rpm\n"
        + "".join(f"{t:.2f},{c:g},{y:.2f}\n" for t, c, y in zip(time_s, command, read, strict=True))
    )
    before = load_config("drive_alone", MACHINE_KIND).model
    after, place = add_effect(before, "shaft.gain", 5.0), tmp_path / "new.yaml"
    save_config(
        place, append_history(before, after, data="run.csv", date="2026-07-09"), MACHINE_KIND
    )
    service, told = DiagnosisFiles([tmp_path], own=tmp_path / "own"), []
    found = service.compare_machines(
        str(place), service.find_source(str(log)), lambda *said: told.append(said), StopSignal()
    )
    shaft = found.rows[0]
    assert (
        (shaft.channel, shaft.unit) == ("shaft", "r/min")
        and shaft.new < shaft.old
        and shaft.low > 0.0
    )
    assert (
        Path(found.report).parent == tmp_path / "own" / "reports"
        and "<svg" in Path(found.report).read_text()
    )
    assert [share for share, _ in told] == sorted(share for share, _ in told) and len(told) > 2
    stop = StopSignal()
    stop.set()
    with pytest.raises(WorkStopped):
        service.compare_machines(
            str(place), service.find_source(str(log)), lambda *said: None, stop
        )


def test_installing_runs_the_installer_and_says_its_last_line_where_it_fails(
    files, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(program: str) -> None:
        monkeypatch.setattr(diagnosis, "find_installer", lambda: (sys.executable, "-c", program))
        files.install_extra(lambda share, stage: None, StopSignal())

    run("import sys; assert sys.argv[1].startswith('numba>=')")
    with pytest.raises(ValueError, match=r"no network$"):
        run("import sys; sys.exit('looking\\nno network')")
    monkeypatch.setattr(diagnosis, "is_extra_installed", lambda extra: False)
    with pytest.raises(ValueError, match=r"ended with 0$"):
        run("")
