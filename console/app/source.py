"""Where frames come from and orders go to. The screens know nothing else of the machine."""

from __future__ import annotations

from typing import Protocol

from topdress.console.frame import DeviceDo, Frame
from topdress.control.orders import Answer, Order


class FrameSource(Protocol):
    """Gives frames and takes orders: a control worker's link, a replayed log, or a test's
    stand-in."""

    @property
    def newest(self) -> Frame | None:
        """The last frame that arrived; None before the first."""

    async def run_connection(self) -> None:
        """Keeps `newest` new. Raises `console.link.WorkerGone` when the other end is gone."""

    async def send_order(self, order: Order) -> Answer:
        """Sends one order and waits for its answer. Raises `console.link.WorkerGone`."""

    async def send_device_order(self, name: str, do: DeviceDo) -> Answer:
        """Asks something of one device, by its name in the frame. Raises
        `console.link.WorkerGone`."""

    async def send_lag_test_order(self, begin: bool) -> Answer:
        """Begins or ends the lag test, which measures while the state is calibrating. Raises as
        `order`."""


class FrameArrival:
    """Holds the newest frame and its arrival."""

    def __init__(self) -> None:
        self.frame: Frame | None = None
        self._at_s = 0.0

    def take_frame(self, frame: Frame | None, now_s: float) -> bool:
        """Take the newest frame; true when it is another than before."""
        if frame is None or (
            self.frame is not None and frame.seq == self.frame.seq and frame.at_s == self.frame.at_s
        ):
            return False
        self.frame, self._at_s = frame, now_s
        return True

    def calc_age_s(self, now_s: float) -> float:
        """Age of the frame shown, s; 0 before the first frame."""
        return 0.0 if self.frame is None else max(0.0, now_s - self._at_s)
