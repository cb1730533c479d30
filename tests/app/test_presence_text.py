"""What a screen says of others at the same machine."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.attach_notice import JoinedMachineFacts
from topdress.console.app.dialogs import TextDialog
from topdress.console.app.order_words import ORDER_NAMES
from topdress.console.app.pages.page_registry import SCREEN_CLASSES
from topdress.console.app.presence_text import describe_leaving
from topdress.console.app.services import Services
from topdress.console.attached_consoles import AttachedConsole, ExecutedOrder
from topdress.control.orders import Do

from tests.app.harness import in_state, later, looked, text_of, turned
from tests.app.made_up.job import SampleJobService

OWN = AttachedConsole("ann@cab pts/3", False, True, True)
LAB = AttachedConsole("lab@cab pts/4", False, True, True)
TABLET = AttachedConsole("tablet Ann", True, True, False)
OFFICE = AttachedConsole("tablet office", True, False, False)
PAGES = [where for where in SCREEN_CLASSES if where != "replay"]


def now(source, state=None, **changes):
    in_state(source, state or source.current_frame.row.state, **changes)


@pytest.fixture
def several(source):
    """The source of a console that has company; `ordered` 63 s before the newest row."""
    source.name = OWN.name
    time_s = source.current_frame.row.time_s - 63.0
    now(
        source,
        state="working",
        attached=(OWN, LAB, TABLET, OFFICE),
        consoles=2,
        ordered=(
            ExecutedOrder("start", "", OWN.name, time_s - 9.0),
            ExecutedOrder("nudge", "5.0", TABLET.name, time_s),
        ),
    )
    return source


@pytest.mark.parametrize("size", [(120, 40), (80, 24)])
@pytest.mark.parametrize("where", PAGES)
async def test_every_page_says_who_ordered_and_who_is_there(app, several, size, where, pilot):
    await turned(app, pilot, where)
    text = text_of(app)
    assert "nudge +5 % by tablet Ann" in text and "at this machine: this one, lab@cab" in text


async def test_a_console_alone_has_no_row_more(app, source):
    source.name = OWN.name
    now(source, attached=(OWN,), ordered=(ExecutedOrder("hold", "", OWN.name, 1.0),))
    async with app.run_test(size=(120, 40)) as pilot:
        await looked(app, pilot)
        assert "at this machine" not in text_of(app)
        # who ordered and left stays named
        now(source, ordered=(ExecutedOrder("hold", "", "lab@cab pts/4", 2.0),))
        await looked(app, pilot)
        assert "HOLD by lab@cab pts/4" in text_of(app)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"attached": (OWN, LAB, TABLET)}, "tablet office has left"),
        (
            {"attached": (OWN, LAB, TABLET, OFFICE, AttachedConsole("new", False, True, True))},
            "new has joined (console, keeps the machine working)",
        ),
        (
            {"attached": (OWN, TABLET, OFFICE)},
            "lab@cab pts/4 has left: the machine goes on, ann@cab pts/3 keeps it working",
        ),
        (
            {"attached": (OWN._replace(keeps=False), TABLET, OFFICE)},
            "lab@cab pts/4 has left: no console is left, the machine is held after 2 s",
        ),
        (
            {"attached": (OWN, LAB._replace(keeps=False), TABLET, OFFICE)},
            "lab@cab pts/4 is silent: the machine goes on, ann@cab pts/3 keeps it working",
        ),
        ({"attached": (OWN, TABLET, OFFICE), "state": "held"}, "lab@cab pts/4 has left"),
        ({"ordered": (ExecutedOrder("hold", "", LAB.name, 500.0),)}, "lab@cab pts/4: HOLD"),
        (
            {"ordered": (ExecutedOrder("strategy", "speed_first", TABLET.name, 500.0),)},
            "tablet Ann: strategy speed first",
        ),
        ({"ordered": (ExecutedOrder("hold", "", OWN.name, 500.0),)}, ""),
    ],
)
async def test_what_the_others_do_is_said_when_it_happens(app, several, changes, said, pilot):
    app.show_newest()
    app.show_notice("")
    now(several, **changes)
    await later(app, pilot)
    assert app.notice_text == said


async def test_who_joins_a_machine_at_work_reads_whom_it_found(several, clock):
    app = TopdressApp(
        several,
        clock,
        live=False,
        utc_offset_s=0.0,
        services=Services(job=SampleJobService()),
        joined=JoinedMachineFacts("2026-11-23T07:12:00+00:00", "/logs/run.csv"),
    )
    async with app.run_test(size=(120, 40)) as pilot:
        await looked(app, pilot)
        assert isinstance(app.screen, TextDialog) and "joined it" in app.screen.heading
        for one in (
            "lab@cab pts/4 (console, keeps the machine working)",
            "tablet office (tablet, looks only)",
            "Latest order: nudge +5 % by tablet Ann",
        ):
            assert one in app.screen.text


async def test_a_click_on_the_row_lists_everybody_and_the_latest_orders(app, several, pilot):
    await looked(app, pilot)
    await pilot.click("#company")
    await pilot.pause()
    assert isinstance(app.screen, TextDialog)
    lines = app.screen.text.splitlines()
    assert lines[0] == "ann@cab pts/3 (this one):  console, keeps the machine working"
    assert lines[2] == "tablet Ann:  tablet, orders, does not keep the machine working"
    assert [line.partition(",")[0] for line in lines[-2:]] == [
        "nudge +5 % by tablet Ann",
        "START by this console",
    ]


@pytest.mark.parametrize(
    ("attached", "said"),
    [
        ((OWN,), "The machine works: it is held after 2 s without console."),
        ((OWN, LAB), "The machine works, and goes on: lab@cab pts/4 keeps it working."),
        (
            (OWN, LAB._replace(keeps=False)),
            "The machine works: it is held after 2 s without console. None of those that "
            "stay keeps it working: lab@cab pts/4.",
        ),
        (
            (OWN, TABLET, OFFICE),
            "The machine works: it is held after 2 s without console. None of those that "
            "stay keeps it "
            "working: tablet Ann, tablet office (looks only).",
        ),
        (
            (OWN._replace(keeps=False), LAB),
            "The machine works, and goes on: lab@cab pts/4 keeps it working.",
        ),
    ],
)
def test_leaving_says_what_becomes_of_the_machine_with_these_others(source, attached, said):
    frame = replace(
        source.current_frame, attached=attached, consoles=sum(one.keeps for one in attached)
    )
    assert describe_leaving(frame, OWN.name, True) == said


def test_every_order_has_a_word():
    assert set(ORDER_NAMES) == set(Do) - {Do.ACKNOWLEDGE}, (
        "that one is no event of the log: the alarm says it"
    )
