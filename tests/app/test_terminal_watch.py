"""A console whose terminal goes away ends, and leaves the terminal as it was."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
import tty

import pytest
from topdress.console.app.terminal_watch import WRITER_THREAD, TerminalWatch, leave_with_terminal

SOON_S = 5.0  # for a thread on a busy computer
# A console without a machine.
CONSOLE = """
import sys
from topdress.console.app.app import TopdressApp
from topdress.console.cli.screens import run_on_terminal
run_on_terminal(TopdressApp(None))
"""


def watch_of(handle):
    """Of this terminal, and never the end of the test's own process."""
    return lambda leave: TerminalWatch(leave, (handle,), end=lambda code: None)


# It leads the terminal's session, hears the hang-up alone, and waits, as make does.
PARENT = f"""
import fcntl, signal, subprocess, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
signal.signal(signal.SIGHUP, lambda *_: None)
subprocess.run([sys.executable, "-c", {CONSOLE!r}])
"""


@pytest.fixture
def terminal():
    master, slave = pty.openpty()
    yield master, slave
    for handle in (master, slave):
        with contextlib.suppress(OSError):
            os.close(handle)


def test_a_terminal_that_hangs_up_has_the_program_leave(terminal):
    master, slave = terminal
    left = threading.Event()
    watch = TerminalWatch(left.set, (slave,))
    watch.start_watch()
    assert not left.wait(0.05) and not watch.is_gone
    os.close(master)
    assert left.wait(SOON_S) and watch.is_gone
    watch.stop_watch()


def test_a_program_that_does_not_leave_is_ended_and_its_terminal_is_as_before(terminal):
    master, slave = terminal
    ended = threading.Event()
    codes = []

    def end(code):
        codes.append(code)
        ended.set()

    before = termios.tcgetattr(slave)
    watch = TerminalWatch(lambda: None, (slave,), grace_s=0.01, end=end)
    tty.setraw(slave)
    watch.start_watch()
    watch.hang_up()
    assert ended.wait(SOON_S) and codes == [130]
    assert termios.tcgetattr(slave) == before
    assert b"\x1b[?1049l" in os.read(master, 1000)
    watch.stop_watch()


def test_a_program_that_ended_by_itself_is_left_alone(terminal):
    _master, slave = terminal
    with leave_with_terminal(lambda: pytest.fail("it has left"), watch_of(slave)) as is_gone:
        pass
    assert not is_gone()


@pytest.mark.parametrize("name", ["SIGHUP", "SIGTERM"])
def test_the_signals_of_a_closed_window_have_the_program_leave(terminal, name):
    left, before = threading.Event(), signal.getsignal(name := getattr(signal, name))
    with leave_with_terminal(left.set, watch_of(terminal[1])) as is_gone:
        os.kill(os.getpid(), name)
        assert left.wait(SOON_S) and is_gone()
    assert signal.getsignal(name) == before


def test_a_hang_up_that_the_caller_ignores_stays_ignored(terminal):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with leave_with_terminal(lambda: pytest.fail("nohup"), watch_of(terminal[1])):
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_write_that_fails_has_the_program_leave(terminal):
    left = threading.Event()

    def write():
        raise OSError("no space left")

    with leave_with_terminal(left.set, watch_of(terminal[1])):
        writer = threading.Thread(target=write, name=WRITER_THREAD)
        writer.start()
        writer.join()
        assert left.wait(SOON_S)


def test_a_console_under_make_ends_within_two_seconds_of_its_window():
    """It read the end of file for ever, with a core of its own."""
    master, slave = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", PARENT],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
    ) as program:
        os.close(slave)
        drawn = b""
        while b"no machine" not in drawn:
            drawn += os.read(master, 4096)
        os.close(master)
        closed_s = time.monotonic()
        try:
            program.wait(SOON_S)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
        assert time.monotonic() - closed_s < 2.0
