"""Plays the frames of a log on a clock of its own: play, pause, seek, step, 0.1x to 1000x."""

from __future__ import annotations

import asyncio
from bisect import bisect_right
from collections.abc import Callable, Sequence

from topdress.console.frame import Frame
from topdress.control.orders import Answer, Order

# Limits of the speed, as a multiple of real time.
MIN_PLAY_SPEED, MAX_PLAY_SPEED = 0.1, 1000.0
# Steps of about a factor of 2.
PLAY_SPEEDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


class ReplaySource:
    """Plays recorded frames in the order of row.time_s.

    Parameters
    ----------
    frames
        Frames of the log.
    clock
        Returns s, as `time.monotonic`.

    Raises
    ------
    ValueError
        The log has no rows.
    """

    def __init__(self, frames: Sequence[Frame], clock: Callable[[], float]) -> None:
        if not frames:
            raise ValueError("replay: the log has no rows; nothing can be played")
        self._clock = clock
        self.speed = 1.0
        self.playing = False
        self._take_frames(frames)
        self._log_s = self.start_s
        self._since_s = clock()

    def _take_frames(self, frames: Sequence[Frame]) -> None:
        """Adopt frames and their times."""
        self.frames = tuple(frames)
        # Sorted times allow a binary search.
        self._times = [frame.row.time_s for frame in self.frames]
        self.start_s, self.end_s = self._times[0], self._times[-1]

    def replace_frames(self, frames: Sequence[Frame]) -> None:
        """Replace the frames by recomputed frames; position and speed stay. Raises ValueError for
        empty frames."""
        if not frames:
            raise ValueError("replay: the recomputed log has no rows")
        at_s = self.at_s
        self._take_frames(frames)
        self.seek_time(at_s)

    @property
    def at_s(self) -> float:
        """Position in the log, s of the log's time."""
        if not self.playing:
            return self._log_s
        return min(self.end_s, self._log_s + (self._clock() - self._since_s) * self.speed)

    @property
    def frame_index(self) -> int:
        """Index of the frame in force at the position: the last frame that is not later."""
        # The tolerance includes a frame exactly at the position despite rounding.
        return max(0, bisect_right(self._times, self.at_s + 1e-9) - 1)

    @property
    def current_frame(self) -> Frame:
        """Frame at the position in the log."""
        return self.frames[self.frame_index]

    @property
    def frame_age_s(self) -> float:
        """Age of the newest frame in the log's time, s; it exceeds the period of the rows only in a
        gap."""
        return max(0.0, self.at_s - self._times[self.frame_index])

    @property
    def is_at_end(self) -> bool:
        """Whether the end of the log is reached."""
        return self.at_s >= self.end_s

    def find_first_index(self, time_s: float) -> int:
        """Return the index of the first frame at or after a time of the log."""
        return min(bisect_right(self._times, time_s - 1e-9), len(self.frames) - 1)

    def start_playing(self) -> None:
        """Start playing; from the start of the log if its end was reached."""
        # Playing at the end would stand still.
        if self.is_at_end:
            self._log_s = self.start_s
        self._since_s = self._clock()
        self.playing = True

    def pause_playing(self) -> None:
        """Stop playing at the present position."""
        self._log_s = self.at_s
        self.playing = False

    def toggle_playing(self) -> None:
        """Play or pause."""
        if self.playing and not self.is_at_end:
            self.pause_playing()
        else:
            self.start_playing()

    def seek_time(self, time_s: float) -> None:
        """Seek a time of the log, limited to the log."""
        self._log_s = max(self.start_s, min(self.end_s, time_s))
        self._since_s = self._clock()

    def step_rows(self, rows: int) -> None:
        """Pause, and move by whole rows."""
        index = max(0, min(len(self.frames) - 1, self.frame_index + rows))
        self.playing = False
        self.seek_time(self._times[index])

    def set_speed(self, speed: float) -> None:
        """Set the speed as a multiple of real time, limited to 0.1 to 1000."""
        # The position must be fixed before the speed changes, because it is the elapsed time times
        # the speed.
        self.seek_time(self.at_s)
        self.speed = max(MIN_PLAY_SPEED, min(MAX_PLAY_SPEED, speed))

    def change_speed(self, steps: int) -> None:
        """Move up or down the list of speeds."""
        at = max(0, bisect_right(PLAY_SPEEDS, self.speed) - 1)
        self.set_speed(PLAY_SPEEDS[max(0, min(len(PLAY_SPEEDS) - 1, at + steps))])

    def seek_next_alarm(self) -> bool:
        """Seek the next frame with an alarm that the frame before lacks, and return True; return
        False without such a frame."""
        for index in range(self.frame_index + 1, len(self.frames)):
            # A standing alarm is no new event.
            before = {alarm.id for alarm in self.frames[index - 1].alarms}
            if any(alarm.id not in before for alarm in self.frames[index].alarms):
                self.playing = False
                self.seek_time(self._times[index])
                return True
        return False

    async def run(self) -> None:
        """Wait for ever: a log has no connection that could end."""
        await asyncio.Event().wait()

    async def order(self, order: Order) -> Answer:
        """Refuse every order, because a log executes none."""
        return Answer(False, "replay")
