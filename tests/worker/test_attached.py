"""Several at one machine: who is attached and who ordered what, on every screen and in the
log's events."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap

import pytest
from topdress.console.attached_consoles import (
    MAX_NAME_CHARACTERS,
    AttachedConsole,
    ExecutedOrder,
    clean_name,
    find_own_name,
    make_unique_name,
    read_orders,
)
from topdress.console.cli.tablet import TabLink
from topdress.console.frame import parse_frame
from topdress.console.link import Link
from topdress.control.orders import Answer, Do, Order

from tests.waiting import until

posix = pytest.mark.skipif(os.name != "posix", reason="sends signals")


@pytest.fixture
async def join():
    """A link of any kind whose first frame has come; all are cut after the test."""
    tasks = []

    async def to(link):
        link.task = asyncio.create_task(link.run_connection())
        tasks.append(link.task)
        await asyncio.wait_for(link.attached.wait(), 30)
        return link

    yield to
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def names(link):
    return [one.name for one in link.current_frame.attached]


def events_of(rows):
    return [event for row in rows for event in (row.get("events") or "").split(";") if event]


async def test_two_consoles_and_two_tablets_see_each_other_and_who_ordered(running, join, log_of):
    where = running()
    ann, lab = await join(Link(where, "ann@cab pts/3")), await join(Link(where, "lab@cab pts/4"))
    tablet = await join(TabLink(where, "tablet Ann"))
    looks = await join(TabLink(where.drop_token(), "tablet office"))
    everybody = (ann, lab, tablet, looks)
    wanted = {
        AttachedConsole("ann@cab pts/3", False, True, True),
        AttachedConsole("lab@cab pts/4", False, True, True),
        AttachedConsole("tablet Ann", True, True, False),
        AttachedConsole("tablet office", True, False, False),
    }
    for link in everybody:
        await until(lambda link=link: set(link.current_frame.attached) == wanted)
    assert await ann.send_order(Order(Do.START)) == Answer(True)
    assert await tablet.send_order(Order(Do.NUDGE, 5.0)) == Answer(True)
    assert await looks.send_order(Order(Do.STOP)) == Answer(False, "unauthorised")
    assert await lab.send_order(Order(Do.HOLD)) == Answer(True)
    for link in everybody:
        await until(
            lambda link=link: (
                [one[:3:2] for one in link.current_frame.ordered]
                == [("start", "ann@cab pts/3"), ("nudge", "tablet Ann"), ("hold", "lab@cab pts/4")]
            )
        )
    lab.task.cancel()
    await until(lambda: "lab@cab pts/4" not in names(ann))
    await ann.stop_worker()
    events = events_of(log_of(where))
    assert events[:3] == [
        "attached ann@cab pts/3, console",
        "attached lab@cab pts/4, console",
        "attached tablet Ann, tablet",
    ]
    assert "attached tablet office, tablet, looks only" in events
    for event in (
        "start_by ann@cab pts/3",
        "nudge_by tablet Ann",
        "hold_by lab@cab pts/4",
        "left lab@cab pts/4",
        "stop_by ann@cab pts/3",
    ):
        assert events.count(event) == 1
    assert not any(event.startswith("stop_by tablet") for event in events)


CONSOLE = textwrap.dedent("""
    import asyncio, json, sys
    from topdress.console.link import Link
    from topdress.console.running import WorkerAddress
    async def main():
        link = Link(WorkerAddress(**json.loads(sys.argv[1])), sys.argv[2])
        task = asyncio.create_task(link.run_connection())
        await link.attached.wait()
        print("attached", flush=True)
        await task
    asyncio.run(main())
""")


def console_of(where, name):
    there = {"port": where.port, "token": where.token, "pid": where.pid}
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", CONSOLE, json.dumps(there), name], stdout=subprocess.PIPE
    )
    assert process.stdout is not None and process.stdout.readline() == b"attached\n"
    return process


@posix
async def test_one_of_two_consoles_goes_and_the_machine_goes_on_the_last_goes_and_it_is_held(
    running, join, log_of
):
    """A tablet that operates stays open all the time: it keeps nothing working."""
    where = running()
    tablet = await join(TabLink(where, "tablet Ann"))
    first, second = console_of(where, "first"), console_of(where, "second")
    try:
        await until(lambda: sum(one.keeps for one in tablet.current_frame.attached) == 2)
        await tablet.send_order(Order(Do.START))
        await until(lambda: tablet.current_frame.row.state == "working")
        os.kill(first.pid, signal.SIGKILL)
        await until(lambda: names(tablet) == ["tablet Ann", "second"])
        at_s = tablet.current_frame.at_s
        await until(lambda: tablet.current_frame.at_s > at_s + 3.0)
        assert tablet.current_frame.row.state == "working", "the other console keeps it working"
        os.kill(second.pid, signal.SIGKILL)
        await until(lambda: names(tablet) == ["tablet Ann"])
        at_s = tablet.current_frame.at_s
        await until(lambda: tablet.current_frame.row.state == "held")
        # its last word was up to 1 s old on a busy machine
        assert 0.5 < tablet.current_frame.at_s - at_s < 4.0
        assert tablet.current_frame.alarms[0].id == "console_silent"
    finally:
        for one in (first, second):
            one.kill()
            one.wait()
    await tablet.stop_worker()
    events = events_of(log_of(where))
    assert events.index("left first") < events.index("left second")
    assert not any(event.startswith("hold_by") for event in events), (
        "nobody ordered it: the alarm says why"
    )


@posix
async def test_a_console_that_freezes_is_silent_and_heard_again(running, join, log_of):
    where = running()
    own = await join(Link(where, "own"))
    other = console_of(where, "other")
    try:
        await until(lambda: len(names(own)) == 2 and own.current_frame.attached[1].keeps)
        os.kill(other.pid, signal.SIGSTOP)
        await until(lambda: not own.current_frame.attached[1].keeps)
        os.kill(other.pid, signal.SIGCONT)
        await until(lambda: own.current_frame.attached[1].keeps)
    finally:
        other.kill()
        other.wait()
    await until(lambda: names(own) == ["own"])
    await own.stop_worker()
    events = events_of(log_of(where))
    # on a busy machine it may be late once more
    said = [one for one in events if one.endswith(" other")]
    assert said[:2] == ["silent other", "heard other"] and said[-1] == "left other"


async def test_two_of_one_name_are_told_apart_and_each_knows_its_own(running, join):
    where = running()
    first, second = await join(Link(where, "cab")), await join(Link(where, "cab"))
    await until(lambda: names(first) == ["cab", "cab #2"])
    assert (first.name, second.name) == ("cab", "cab #2")
    second.task.cancel()
    await until(lambda: names(first) == ["cab"])
    again = await join(Link(where, "cab"))
    await until(lambda: names(first) == ["cab", "cab #2"])
    assert again.name == "cab #2"


async def test_a_console_of_before_says_no_name_and_takes_the_frames_as_ever(running, join):
    """Its words are those of older consoles: a look and signs of life without a name."""
    where = running()
    own = await join(Link(where, "own"))
    with socket.create_connection(("127.0.0.1", where.port), timeout=5) as old:
        old.sendall(json.dumps({"id": 1, "token": where.token, "ask": "look"}).encode() + b"\n")
        old.sendall(
            json.dumps({"id": 2, "token": where.token, "do": "hold", "value": None}).encode()
            + b"\n"
        )
        await until(lambda: names(own) == ["own", "console"])
        await until(
            lambda: (
                own.current_frame.ordered
                and own.current_frame.ordered[-1][:3:2] == ("hold", "console")
            )
        )
        said = old.makefile("rb")
        lines = [json.loads(said.readline()) for _four in range(4)]
    assert {"answer": 1, "accepted": True, "why": ""} in lines, "no name was said: none is answered"


def test_a_frame_of_a_worker_of_before_has_nobody_and_one_of_a_later_one_has_more_of_each():
    plain = {"seq": 1, "at_s": 0.0, "row": {"time_s": 0.0}, "consoles": 2}
    assert parse_frame(plain).attached == ()
    assert parse_frame(plain | {"attached": [{"name": "ann", "seat": 2}]}).attached == (
        AttachedConsole("ann"),
    )


async def test_who_comes_and_goes_without_the_token_fills_no_log(running, join, log_of):
    where = running()
    own = await join(Link(where, "own"))
    for number in range(20):
        with socket.create_connection(("127.0.0.1", where.port), timeout=5) as stranger:
            stranger.sendall(
                json.dumps({"id": 1, "ask": "look", "name": f"stranger {number}"}).encode() + b"\n"
            )
            await asyncio.sleep(0.05)
    await own.stop_worker()
    assert not any("stranger" in event for event in events_of(log_of(where)))


@pytest.mark.parametrize(
    ("said", "name"),
    [
        ("ann@cab pts/3", "ann@cab pts/3"),
        ("a;stop_by b,c", "a stop_by b c"),
        ("\x1b[2J\nann\t", "[2J ann"),
        ("x" * 99, "x" * MAX_NAME_CHARACTERS),
        (None, ""),
        (7, ""),
        ("  ", ""),
        ("李师傅", "李师傅"),
    ],
)
def test_a_name_breaks_neither_the_log_nor_the_screen(said, name):
    assert clean_name(said) == name


def test_names_that_are_taken_get_a_number():
    assert (
        make_unique_name("a", []) == "a"
        and make_unique_name("a", ["a"]) == "a #2"
        and make_unique_name("a", ["a", "a #2"]) == "a #3"
    )
    assert (
        len(make_unique_name("x" * MAX_NAME_CHARACTERS, ["x" * MAX_NAME_CHARACTERS]))
        <= MAX_NAME_CHARACTERS
    )


def test_a_console_is_named_by_its_user_computer_and_terminal_or_as_it_is_given(monkeypatch):
    monkeypatch.delenv("TOPDRESS_NAME", raising=False)
    assert "@" in find_own_name()
    monkeypatch.setenv("TOPDRESS_NAME", "cab left")
    assert find_own_name() == "cab left" and find_own_name("by option") == "by option"


def test_orders_are_read_out_of_a_cell_of_events():
    cell = "nudge 5.0;nudge_by ann;mark start_by nobody;hold;hold_by tablet 2;refill 50;left ann"
    assert list(read_orders(cell, 3.0)) == [
        ExecutedOrder("nudge", "5.0", "ann", 3.0),
        ExecutedOrder("hold", "", "tablet 2", 3.0),
    ]
    assert list(read_orders(None, 0.0)) == []
