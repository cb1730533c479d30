"""A log's frames on a clock of their own: play, pause, seek, step, 0.1x to 1000x. Orders are
refused."""

from __future__ import annotations

import asyncio
from bisect import bisect_right
from collections.abc import Callable, Sequence

from topdress.console.frame import Frame
from topdress.control.orders import Answer, Order

SLOWEST, FASTEST = 0.1, 1000.0
SPEEDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


class ReplaySource:
    """A FrameSource over recorded frames, in order of row.time_s. `clock` gives s, as
    time.monotonic does.

    Raises ValueError for a log without rows.
    """

    def __init__(self, frames: Sequence[Frame], clock: Callable[[], float]) -> None:
        if not frames:
            raise ValueError("replay: the log has no rows; nothing can be played")
        self._clock = clock
        self.speed = 1.0
        self.playing = False
        self._take(frames)
        self._log_s = self.start_s
        self._since_s = clock()

    def _take(self, frames: Sequence[Frame]) -> None:
        self.frames = tuple(frames)
        self._times = [frame.row.time_s for frame in self.frames]
        self.start_s, self.end_s = self._times[0], self._times[-1]

    def replace(self, frames: Sequence[Frame]) -> None:
        """Other frames (a what-if), at the place and speed that are played now. Raises
        ValueError when empty."""
        if not frames:
            raise ValueError("replay: the recomputed log has no rows")
        at_s = self.at_s
        self._take(frames)
        self.seek(at_s)

    @property
    def at_s(self) -> float:
        """Place in the log, s of its own time."""
        if not self.playing:
            return self._log_s
        return min(self.end_s, self._log_s + (self._clock() - self._since_s) * self.speed)

    @property
    def index(self) -> int:
        """Frame in force at the place: the last one not later."""
        return max(0, bisect_right(self._times, self.at_s + 1e-9) - 1)

    @property
    def newest(self) -> Frame:
        return self.frames[self.index]

    @property
    def age_s(self) -> float:
        """How old the newest frame is in the log's time: more than its step only in a gap."""
        return max(0.0, self.at_s - self._times[self.index])

    @property
    def at_end(self) -> bool:
        return self.at_s >= self.end_s

    def first_index(self, time_s: float) -> int:
        """First frame at or after a time of the log."""
        return min(bisect_right(self._times, time_s - 1e-9), len(self.frames) - 1)

    def play(self) -> None:
        """Goes on; from the start again when the end was reached."""
        if self.at_end:
            self._log_s = self.start_s
        self._since_s = self._clock()
        self.playing = True

    def pause(self) -> None:
        self._log_s = self.at_s
        self.playing = False

    def toggle(self) -> None:
        if self.playing and not self.at_end:
            self.pause()
        else:
            self.play()

    def seek(self, time_s: float) -> None:
        """To a time of the log, held inside it."""
        self._log_s = max(self.start_s, min(self.end_s, time_s))
        self._since_s = self._clock()

    def step(self, rows: int) -> None:
        """Pauses, and moves by whole rows."""
        index = max(0, min(len(self.frames) - 1, self.index + rows))
        self.playing = False
        self.seek(self._times[index])

    def set_speed(self, speed: float) -> None:
        """Times faster than life, held within 0.1 ... 1000."""
        self.seek(self.at_s)
        self.speed = max(SLOWEST, min(FASTEST, speed))

    def change_speed(self, steps: int) -> None:
        """Up or down the speeds 0.1, 0.2, 0.5, 1, 2, 5, ... 1000."""
        at = max(0, bisect_right(SPEEDS, self.speed) - 1)
        self.set_speed(SPEEDS[max(0, min(len(SPEEDS) - 1, at + steps))])

    def next_alarm(self) -> bool:
        """To the next frame that has an alarm which the one before has not; false where there
        is none."""
        for index in range(self.index + 1, len(self.frames)):
            before = {alarm.id for alarm in self.frames[index - 1].alarms}
            if any(alarm.id not in before for alarm in self.frames[index].alarms):
                self.playing = False
                self.seek(self._times[index])
                return True
        return False

    async def run(self) -> None:
        """A log is never gone."""
        await asyncio.Event().wait()

    async def order(self, order: Order) -> Answer:
        return Answer(False, "replay")
