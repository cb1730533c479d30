"""Which field and job, asked at the start: recent first, one key leaves all as it is, nothing
waits for an answer."""

from __future__ import annotations

import datetime as dt
import os
from pathlib import Path

import pytest
from topdress.console.app.dialogs import ChoiceDialog
from topdress.console.app.first_question import ask_first_question
from topdress.console.app.pages.job.service import JobOffer
from topdress.console.app.widgets.choice_list import ChoiceList
from topdress.console.cli import screens
from topdress.console.services.job import JobFiles
from topdress.console.services.launcher import Launcher
from topdress.console.services.recent_jobs import find_recent_sets
from topdress.control.orders import Do, Order
from topdress.drivers.files.config import find_shipped_files, load_config, save_config
from topdress.drivers.files.config_kinds import JOB_KIND
from topdress.drivers.files.run_log import PlainLogWriter
from topdress.drivers.files.run_meta import make_run_meta

from tests.app.harness import feed, in_state, settled
from tests.command import topdress

SIZES = [(120, 40), (80, 24), (60, 20)]


@pytest.fixture
def full(full, source):
    in_state(source, "off", alarms=())
    return full


async def asked(app, pilot):
    await pilot.pause()
    ask_first_question(app, app.services.job)
    await settled(app, pilot)


@pytest.mark.parametrize("size", SIZES)
async def test_one_key_takes_the_newest_and_one_leaves_all_as_it_is(full, source, size, shown):
    desk = full.services.job
    async with full.run_test(size=size) as pilot:
        await asked(full, pilot)
        assert isinstance(full.screen, ChoiceDialog)
        text = "\n".join(shown(full))
        assert (
            "Which field and job?" in text
            and "2026-03-17 13:05  North 40" in text
            and "0.86 ha done" in text
        )
        assert any(0x2800 < ord(character) < 0x2900 for character in text), "a small picture"
        marked = full.screen.query_one(ChoiceList).render().split("\n")[0]
        assert not any(str(span.style).startswith("#") for span in marked.spans), (
            "the picture is seen on the mark too"
        )
        await pilot.press("end")
        assert "not worked yet" in "\n".join(shown(full))
        await pilot.press("home")
        await pilot.press("escape")
        assert full.screen is full.page and ("recent",) not in [one[:1] for one in desk.asked]
        ask_first_question(full, desk)
        await settled(full, pilot)
        await pilot.press("enter")
        await settled(full, pilot)
        assert (
            "recent",
            "jobs/north-40.yaml",
            "machines/spreader.yaml",
            "cabs/red.yaml",
        ) in desk.asked


@pytest.mark.parametrize(
    ("keys", "how"),
    [(("enter",), "restart"), (("2", "enter"), "restart anew"), (("escape",), "drop")],
)
async def test_a_job_that_was_left_on_that_field_is_asked_about(full, keys, how):
    desk = full.services.job
    desk.cut_off = JobOffer(
        "a.resume.json", "2026-03-18T14:18:00+00:00", "2026-03-18T15:02:00+00:00", "North 40", 1.2
    )
    async with full.run_test(size=(120, 40)) as pilot:
        await asked(full, pilot)
        await pilot.press("enter")
        for _ in range(2):
            await settled(full, pilot)
        assert isinstance(full.screen, ChoiceDialog) and "left on this field" in full.screen.heading
        await pilot.press(*keys)
        await settled(full, pilot)
        assert desk.asked[-1] == (how,)


async def test_hold_and_stop_work_under_it_and_a_machine_that_was_started_is_left_alone(
    full, source
):
    desk = full.services.job
    async with full.run_test(size=(120, 40)) as pilot:
        await asked(full, pilot)
        await pilot.press("x")
        assert Order(Do.STOP) in source.orders and isinstance(full.screen, ChoiceDialog)
        feed(full, [{"state": "working", "time_s": source.current_frame.row.time_s + 1}])
        await pilot.press("enter")
        await settled(full, pilot)
        assert ("drop",) in desk.asked and "stop it first" in full.notice_text and not full.gone
        ask_first_question(full, desk)
        await settled(full, pilot)
        assert full.screen is full.page, "nothing is asked while it works"


async def test_nothing_to_choose_from_is_no_question(full):
    full.services.job.list_recent = lambda: ()
    async with full.run_test(size=(120, 40)) as pilot:
        await asked(full, pilot)
        assert full.screen is full.page


def worked(
    logs: Path, name: str, at: int, *files: Path, job: str = "A job", field: str = "A field"
) -> None:
    """The sidecar of a log, so many seconds after some moment."""
    logs.mkdir(parents=True, exist_ok=True)
    meta = make_run_meta(
        {"title": "A machine"},
        None,
        {"title": job, "field": {"title": field}},
        sha256={str(one): "x" for one in files},
        started_utc=f"2026-03-1{at}T08:00:00Z",
    )
    PlainLogWriter(logs / f"{name}.csv", meta).close()
    os.utime(logs / f"{name}.yaml", (1e9 + at, 1e9 + at))


def test_recent_jobs_are_sets_of_files_the_newest_first(tmp_path):
    logs, own = tmp_path / "logs", tmp_path / "own"
    jobs = {}
    for name in ("north", "south", "gone"):
        jobs[name] = own / "jobs" / f"{name}.yaml"
        jobs[name].parent.mkdir(parents=True, exist_ok=True)
        save_config(
            jobs[name],
            load_config("demo", JOB_KIND).model.model_copy(update={"title": name}),
            JOB_KIND,
        )
    machine = find_shipped_files("machines")["huanghai"]
    worked(logs, "a", 1, jobs["north"], machine, job="north")
    worked(logs, "b", 2, jobs["south"], machine, job="south", field="By the river")
    worked(logs, "c", 3, jobs["north"], machine, job="north")
    worked(logs, "d", 4, find_shipped_files("jobs")["demo"], machine)  # nothing of the user's own
    worked(logs, "e", 5, jobs["gone"], machine)
    jobs["gone"].unlink()
    (logs / "broken.yaml").write_text("format: [")
    save_config(
        own / "jobs" / "new.yaml",
        load_config("demo", JOB_KIND).model.model_copy(update={"title": "new"}),
        JOB_KIND,
    )
    found = find_recent_sets(logs, own)
    assert [(one.job, one.began_utc[:10]) for one in found] == [
        ("north", "2026-03-13"),
        ("south", "2026-03-12"),
        ("new", ""),
    ]
    assert found[1].field == "By the river" and found[0].files == (str(jobs["north"]), str(machine))
    launcher = Launcher((), (), 1, 20.0, None, tmp_path / "trouble.log")
    desk = JobFiles(launcher, own)
    desk.choose_recent(found[1])
    jobs["south"].write_text("format: topdress-job/1\ncolour: red\n")
    with pytest.raises(ValueError, match="south"):
        desk.choose_recent(found[1])
    assert dt.date.fromisoformat(found[0].began_utc[:10]) and launcher.config == ()


def test_run_takes_a_job_by_path_or_name_and_asks_nothing_then(tmp_path, monkeypatch):
    monkeypatch.setattr(screens.platformdirs, "user_data_dir", lambda *_a, **_k: str(tmp_path))
    own = tmp_path / "jobs" / "north.yaml"
    own.parent.mkdir()
    save_config(own, load_config("demo", JOB_KIND).model, JOB_KIND)
    begun = []
    monkeypatch.setattr(screens, "show_run", lambda config, *_rest: begun.append(config))
    for given in (["north"], ["demo"], [str(own)], ["north", "--config", "huanghai"], []):
        assert topdress("run", *given).exit_code == 0
    assert begun == [(str(own),), ("demo",), (str(own),), (str(own), "huanghai"), ()]
