"""When a frame is reported to the consoles: what changed at once, a machine that moves often, one that stands
seldom."""
from __future__ import annotations

from math import inf
from typing import Any

from console.frame import Frame
from console.worker.limits import COMES_S, MOVES_S, STANDS_S
from control.orders import State

AT_WORK = (State.WORKING, State.CALIBRATING)
STANDS_MPS = 0.05           # slower: standing, as the filters of the speed have it
STANDS_RPM = 2.0            # six s.d. of the nominal encoder's noise, as safety has it
HALF_A_TICK_S = 0.02        # a tick that comes a little sooner than it should is the one that is due


class Telling:
    """`due` of every frame; True: tell it. One for all consoles: what one gets all get."""

    def __init__(self) -> None:
        self._sent_s = -inf
        self._words: Any = None         # of the frame reported last
        self._comes, self._come_until_s = False, -inf       # since the frame looked at last; by the clock of frames
        self.moves = True               # by the frame looked at last

    def hurry(self) -> None:
        """The next frame is reported: an order was answered."""
        self._sent_s = -inf

    def come(self) -> None:
        """A console came: it waits for no frame, and its first numbers move at once, as those of a machine at work."""
        self.hurry()
        self._comes = True

    def due(self, frame: Frame) -> bool:
        words = _words(frame)
        if self._comes:
            self._comes, self._come_until_s = False, frame.at_s + COMES_S
        self.moves = _moves(frame) or 0.0 < self._come_until_s - frame.at_s <= COMES_S
        wait_s = MOVES_S if self.moves else STANDS_S
        if words == self._words and 0.0 <= frame.at_s - self._sent_s < wait_s - HALF_A_TICK_S:
            return False
        self._sent_s, self._words = frame.at_s, words
        return True


def _moves(frame: Frame) -> bool:
    """Whether numbers are looked at because something goes on."""
    row = frame.row
    return (row.state in AT_WORK or frame.lag_test is not None or (row.speed_used_mps or 0.0) >= STANDS_MPS
            or (row.shaft_rpm or 0.0) >= STANDS_RPM or any(
                one.test is not None and one.test.running for one in frame.devices))


def _words(frame: Frame) -> tuple[Any, ...]:
    """All of a frame that is no measured number."""
    row = frame.row
    return (row.state, row.strategy, row.target_source, row.nudge_percent, row.work_switch, row.events, row.fix_quality,
            frame.alarms, frame.why_no_flow, frame.why_state, frame.allow, frame.notes, frame.dropped_heads,
            frame.look_ahead, frame.flow_trim_on, frame.no_double, frame.sections, frame.strips, frame.bench is None,
            frame.lag_test, None if frame.tally is None else frame.tally._replace(held_s=0.0), frame.consoles,
            frame.attached, frame.ordered,
            frame.job, frame.machine, frame.crop, frame.log_path,
            [(one.name, one.connected, one.plugged, one.protocol, one.last_error, one.capture_path, one.test)
             for one in frame.devices])
