"""Drop times with the lag rig alone: the machine's own drive turns the shaft, which this program does not command.

Each run: the shaft stands and the tubes are empty; the rig is armed; somebody starts the shaft; the rig times from 2
r/min to the first granule on the plate (lag paper, 1.2). Nothing is known of the response: nobody announced when the
start was wanted. Pure: readings and times in, orders to the rig out.
"""
from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from drivers.devices.lag_rig import ARMED, LANDED, TURNING, RigReadings
from drivers.devices.lag_test import STANDING_RPM

Phase = Literal["stop", "arming", "start", "falling"]


class DropRun(NamedTuple):
    """One measured run; the shaft speed is the rig's own reading when the granule landed."""

    shaft_rpm: float
    drop_s: float


class DropWish(NamedTuple):
    """What is wanted now: `phase` of the person at the machine, `run` and `arm` of the rig."""

    run: int
    arm: bool
    phase: Phase
    said: str = ""                  # a run that failed, and why


class DropTest:
    """One `tick` after the other, for as long as somebody likes; measured runs are in `runs`."""

    def __init__(self, settle_s: float = 3.0, longest_s: float = 8.0) -> None:
        self.runs: list[DropRun] = []
        self._settle_s, self._longest_s = settle_s, longest_s
        self._phase: Phase = "stop"
        self._since_s: float | None = None
        self._number = 0

    def tick(self, now_s: float, rig: RigReadings | None) -> DropWish:
        """`rig`: the newest reading, however old; `now_s` on the clock that stamped it."""
        said = ""
        mine = rig is not None and rig.run == self._number
        if self._phase == "stop":
            self._settle(now_s, rig)
        elif rig is None or not mine:
            pass
        elif self._phase == "arming" and rig.state >= ARMED:
            self._phase = "start"
        elif rig.state == LANDED:
            said = self._landed(rig)
        elif rig.state == TURNING and self._phase == "start":
            self._phase, self._since_s = "falling", now_s
        elif self._phase == "falling" and self._since_s is not None and now_s - self._since_s > self._longest_s:
            said = "nothing landed"
            self._again()
        return DropWish(self._number, self._phase != "stop", self._phase, said)

    def _settle(self, now_s: float, rig: RigReadings | None) -> None:
        standing = rig is not None and now_s - rig.time_s < 0.5 and abs(rig.shaft_rpm.value) < STANDING_RPM
        if not standing:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        elif now_s - self._since_s >= self._settle_s:
            self._number, self._phase = self._number + 1, "arming"

    def _landed(self, rig: RigReadings) -> str:
        self._again()
        if rig.plate_before:
            return "the plate was touched before the shaft turned"
        if rig.turned_before:
            return "the shaft turned before the rig was ready"
        assert rig.drop_s is not None
        self.runs.append(DropRun(abs(rig.shaft_rpm.value), rig.drop_s))
        return ""

    def _again(self) -> None:
        self._phase, self._since_s = "stop", None


def drop_table(runs: Iterable[DropRun]) -> str:
    """The runs as a lag bench table (CSV), in the order in which they were measured."""
    rows = [f"{run.shaft_rpm:.1f},{number},{run.drop_s:.3f}\n" for number, run in enumerate(runs, start=1)]
    return "shaft_rpm,replicate,drop_s\n" + "".join(rows)
