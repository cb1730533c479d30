"""What the screen says of the machine and its job is what runs: no calm beside a fault, no
state of a machine that is gone, no limits of another job."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app import frame_words
from topdress.console.app.app import TopdressApp
from topdress.console.app.attach_notice import JoinedMachineFacts
from topdress.console.app.dialogs import TextDialog
from topdress.console.app.pages.job.map_words import describe_map_check
from topdress.console.app.pages.job.service import RunningLimits
from topdress.console.app.panel_views import explain_rate
from topdress.console.app.services import Services
from topdress.console.app.units import METRIC
from topdress.console.cli.screens import _join_running
from topdress.console.link import WorkerGone
from topdress.console.running import WorkerAddress
from topdress.console.services.launcher import Launcher
from topdress.control.machine.machine import Machine
from topdress.control.orders import Alarm, Answer, Severity
from topdress.control.safety import REFUSALS
from topdress.control.targets.map_check import MapCheck

from tests.app.harness import in_state, later, looked, settled, tell, text_of, turned
from tests.app.made_up.job import SampleJobService

SIZES = ((120, 40), (80, 24))


@pytest.mark.parametrize("size", SIZES)
async def test_a_fault_whose_cause_is_gone_says_what_is_next(app, source, shown, size):
    in_state(source, "fault", why_state="shaft_silent")
    async with app.run_test(size=size) as pilot:
        for where in ("run", "job", "map"):
            await turned(app, pilot, where)
            text = text_of(app)
            assert "FAULT, its cause is gone: R on the Run page makes the machine ready." in text, (
                where
            )
            assert "no alarms" not in text, where


async def test_a_page_that_is_just_being_made_says_what_is_known(app, source, shown, pilot):
    """On a busy computer "NO DATA", "waiting for the first values" stood over a machine at work
    for seconds."""
    await later(app, pilot)
    app.show_newest = lambda: None  # its first look is late
    for where in ("map", "trends", "devices", "calibrate", "diagnosis", "job", "settings"):
        app.turn_to_page(where)
        await pilot.pause()
        text = "\n".join(shown(app))
        assert (
            "WORKING" in text
            and "NO DATA" not in text
            and "no values yet" not in text.splitlines()[1]
        ), where
        assert "all is well" not in text, "nothing was looked at yet"


async def test_a_page_that_was_left_does_not_come_back_with_what_it_said_then(
    app, source, shown, pilot
):
    app.turn_to_page("job")
    await pilot.pause()
    app.turn_to_page("run")
    await pilot.pause()
    in_state(source, "held")
    app.call_after_refresh = lambda *ignored: None
    app.turn_to_page("job")
    await pilot.pause()
    assert "HELD" in shown(app)[0]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("where", ["run", "job", "trends"])
async def test_a_machine_without_worker_is_not_said_to_work_without_alarms(
    app, source, shown, size, where, pilot
):
    await turned(app, pilot, where)
    assert "WORKING" in shown(app)[0] and "was" not in shown(app)[0]
    source.end.set_exception(WorkerGone("process 4711 is gone"))
    await pilot.pause()
    await pilot.press("escape")
    await looked(app, pilot)
    text = "\n".join(shown(app)[:4])
    assert "was WORKING" in text and "NO CONNECTION" in text and "no alarms" not in text
    assert "No connection to the machine: its state and alarms are not known." in " ".join(
        text.split()
    )


async def test_a_silent_worker_says_nothing_of_alarms(app, clock, shown, pilot):
    await later(app, pilot, 3.0)
    assert "was WORKING" in shown(app)[0] and "no values: alarms are not known" in shown(app)[1]


@pytest.mark.parametrize("state", ["ready", "held", "off", "fault"])
def test_while_nothing_is_owed_no_flow_is_too_little(frames, state):
    frame = replace(frames[-1], notes=("limited_zero",), row=frames[-1].row._replace(state=state))
    assert explain_rate(frame) == ()
    working = replace(frame, row=frame.row._replace(state="working"))
    assert explain_rate(working) == ("closed: below the machine's lowest rate",)


# --- texts
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(REFUSALS))
def test_no_refusal_shows_the_name_of_a_value(name):
    for why in (name, f"{name};alarm=console_silent", f"{name};state=held"):
        assert "{" not in frame_words.describe_refusal(why)


async def test_a_refusal_names_the_live_alarm_with_its_values(app, source):
    alarm = Alarm("console_silent", Severity.RED, 0.0, False, (("limit_s", 2.0),))
    in_state(source, "held", alarms=(alarm,))
    source.answer = Answer(False, "acknowledge_first;alarm=console_silent")
    async with app.run_test(size=(120, 40)) as pilot:
        app.show_newest()
        await pilot.press("s")
        assert "The console was not heard for 2 s" in app.notice_text


@pytest.mark.parametrize(
    ("check", "said"),
    [
        (
            MapCheck(1.0, 2.0, 1.0, 2.0, 5000.0, 0.0, 500.0, 0.0, 0.0, 0.0, 0.0, 157.0, 157.0),
            (
                "the map lies 5.0 km away from the field: its rate for outside, 157 kg/ha, "
                "is applied everywhere",
            ),
        ),
        (
            MapCheck(1.0, 2.0, 1.0, 2.0, 5000.0, 0.0, 500.0, 0.0, 0.0, 0.0),
            ("the map lies 5.0 km away from the field: nothing of it is applied",),
        ),
        (
            MapCheck(1.0, 2.0, 0.5, 1.5, 0.0, 0.0, 500.0, 0.0, 0.0, 300.0, 157.0, 120.0, 157.0),
            (
                "0.5000 ha of the map's 1.0000 ha lie outside the field: the map's rate for "
                "outside, 157 kg/ha, is applied there",
                "1.5000 ha of the field's 2.0000 ha have no rate of their own in the map: "
                "its rate for the rest, 120 kg/ha, is "
                "applied there",
            ),
        ),
        (
            MapCheck(1.0, 2.0, 0.5, 1.5, 0.0, 0.0, 500.0, 0.0, 0.0, 300.0),
            (
                "0.5000 ha of the map's 1.0000 ha lie outside the field: not applied",
                "1.5000 ha of the field's 2.0000 ha have no rate in the map: nothing is "
                "applied there",
            ),
        ),
    ],
)
def test_what_is_applied_where_the_map_has_nothing_is_said(check, said):
    assert describe_map_check(check, METRIC) == said


# --- joining
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", SIZES)
async def test_a_console_that_joins_says_so_and_what_it_does_not_use(source, clock, shown, size):
    app = TopdressApp(
        source,
        clock,
        live=False,
        utc_offset_s=0.0,
        services=Services(job=SampleJobService()),
        joined=JoinedMachineFacts(
            "2026-11-23T07:12:00+00:00",
            "/logs/run.csv",
            ("/jobs/north.yaml",),
            ("/jobs/south.yaml",),
        ),
    )
    async with app.run_test(size=size) as pilot:
        assert isinstance(app.screen, TextDialog)
        text = " ".join(" ".join(shown(app)).replace("┃", " ").split())
        for said in (
            "A machine runs already: this console has joined it",
            "It has been on since 07:12",
            "north.yaml",
            "NOT used, though named on this command line: south.yaml",
        ):
            assert said in text, said
        await pilot.press("escape")
        await pilot.press("f10")
        await looked(app, pilot)
        assert "joined a machine that ran already" in "\n".join(shown(app))


@pytest.mark.parametrize("size", SIZES)
async def test_files_that_cannot_be_read_are_not_said_to_be_those_of_this_console(
    source, clock, shown, tmp_path, size
):
    """The log of the machine that runs was removed: the console named its own file as what that
    machine goes by."""
    launcher = Launcher(("/cabs/ours.yaml",), (), 1, 20.0, None, tmp_path / "trouble")
    joined = _join_running(
        launcher, WorkerAddress(1, "x", 2, "2026-11-23T07:12:00+00:00", str(tmp_path / "gone.csv"))
    )
    app = TopdressApp(
        source,
        clock,
        live=False,
        utc_offset_s=0.0,
        services=Services(job=SampleJobService()),
        joined=joined,
    )
    async with app.run_test(size=size) as pilot:
        text = app.screen.text
        assert "go on with that machine" in "\n".join(shown(app))
        assert "Its files are not known" in text and "Its files: " not in text
        assert "Named on this command line, and perhaps NOT used: ours.yaml." in text
        await pilot.press("escape")
        await pilot.press("f10")
        await looked(app, pilot)
        assert "its files cannot be read" in " ".join(" ".join(shown(app)).split())


async def test_the_limits_are_those_of_the_machine_that_runs(source, clock):
    services = Services(job=SampleJobService(), at_work=lambda _log: RunningLimits(180.0, 250.0))
    app = TopdressApp(source, clock, live=False, utc_offset_s=0.0, services=services)
    async with app.run_test(size=(120, 40)) as pilot:
        await settled(app, pilot)
        await pilot.press("m")
        assert app.screen.high == 180.0
        await pilot.press("escape", "f")
        assert app.screen.high == 250.0


async def test_a_strategy_is_chosen_by_what_it_comes_to_on_this_machine(source, clock):
    """The referee's table: 107 to 1283 kg/ha against 76 to 764, lumps 0.18 m apart against 0.80
    at 120 kg/ha."""
    services = Services(
        job=SampleJobService(), at_work=lambda _log: RunningLimits(450.0, 300.0, Machine())
    )
    app = TopdressApp(source, clock, live=False, utc_offset_s=0.0, services=services)
    async with app.run_test(size=(120, 40)) as pilot:
        await settled(app, pilot)
        tell(source, {"target_rate_kg_ha": 120.0, "speed_used_mps": 1.25})
        app.show_newest()
        await pilot.press("t")
        text = " ".join(app.screen.text.split())
        assert (
            "107 to 1283 kg/ha; at 120 kg/ha and 4.5 km/h: steps of 1.8 %, lumps along a "
            "row 0.18 m apart" in text
        )
        assert (
            "76 to 764 kg/ha; at 120 kg/ha and 4.5 km/h: steps of 0.6 %, lumps along a row "
            "0.80 m apart" in text
        )


# --- other consoles
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("consoles", "said"),
    [
        (0, "held after 2 s, unless another console is open"),
        (1, "held after 2 s without console"),
        (2, "goes on: another console is open and keeps it working"),
    ],
)
async def test_leaving_says_what_becomes_of_the_machine(app, source, consoles, said):
    in_state(source, "working", consoles=consoles)
    async with app.run_test(size=(80, 24)) as pilot:
        app.show_newest()
        await pilot.press("ctrl+q")
        assert said in app.screen.text


async def test_a_console_that_ends_is_said_by_the_other(app, source):
    in_state(source, "working", consoles=2)
    async with app.run_test(size=(80, 24)) as pilot:
        app.show_newest()
        assert app.notice_text == ""
        in_state(source, "working", consoles=1)
        await later(app, pilot)
        assert app.notice_text == "another console has ended or is silent; open now: 1"


# --- the machine's state, hold and STOP are in sight on every page
# ----------------------------------------------------


@pytest.mark.parametrize("size", [(60, 20), (80, 24), (120, 40)])
@pytest.mark.parametrize(
    "state, word", [("working", "WORKING"), ("held", "HELD"), ("fault", "FAULT")]
)
async def test_every_page_says_what_the_machine_does(app, source, shown, size, state, word):
    """Replay without a log said NO DATA in the place of WORKING."""
    in_state(source, state, why_state="operator")
    async with app.run_test(size=size) as pilot:
        for where in app.pages:
            await turned(app, pilot, where)
            rows = shown(app)
            assert word in rows[0], (where, rows[0])
            assert "hold" in rows[-1] and "STOP" in rows[-1], where
