"""A terminal that stands: the console on it says no more that it lives."""
from __future__ import annotations

import asyncio
import os

import pytest

from console.app.terminal import STALLED_S, Takes
from console.link import Link
from console.running import Where

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")


@pytest.fixture
def terminal():
    """Both ends of one whose program may be stopped: (what it reads, what is drawn on)."""
    import pty
    near, far = pty.openpty()
    os.set_blocking(far, False)
    yield near, far
    os.close(near)
    os.close(far)


def fill(far):
    with pytest.raises(BlockingIOError):
        while True:
            os.write(far, b"x" * 1000)


def test_one_that_stands_is_noticed_and_one_that_goes_on_too(terminal):
    near, far = terminal
    now_s = [0.0]
    takes = Takes(far, lambda: now_s[0])
    for now_s[0] in (0.1, 10.0):
        assert takes()
    fill(far)
    now_s[0] += STALLED_S
    assert takes(), "so long any terminal may draw"
    now_s[0] += 0.1
    assert not takes()
    now_s[0] += 100.0
    assert not takes()
    while not takes():
        os.read(near, 65536)
    fill(far)
    assert takes(), "it took something just now"


def test_where_there_is_none_nothing_stands():
    now_s = [0.0]
    takes = Takes(None, lambda: now_s[0])
    now_s[0] = 1000.0
    assert takes()


def test_a_console_that_is_not_seen_says_nothing():
    said = []
    link = Link(Where(1, "token", 1))
    link._send = lambda _number, message: said.append(message)

    async def words(shows, count):
        link.shows = lambda: shows
        link._keep_alive()
        await asyncio.sleep(0.35)
        link._next_word.cancel()
        assert (len(said) >= count) if shows else not said

    asyncio.run(words(False, 0))
    asyncio.run(words(True, 2))
