"""Declares the source of frames and the receiver of orders, which is everything that screens know
of the machine.
"""

from __future__ import annotations

from typing import Protocol

from topdress.console.frame import DeviceDo, Frame
from topdress.control.orders import Answer, Order


class FrameSource(Protocol):
    """Provides frames and executes orders: the link to a control worker, or a substitute in
    tests."""

    @property
    def current_frame(self) -> Frame | None:
        """Newest frame; None before the first frame."""

    async def run_connection(self) -> None:
        """Update `current_frame` until the connection ends. Raises `console.link.WorkerGone` when
        the other end is lost."""

    async def send_order(self, order: Order) -> Answer:
        """Send an order and return its answer. Raises `console.link.WorkerGone`."""

    async def send_device_order(self, name: str, do: DeviceDo) -> Answer:
        """Send a request for one device, by its name in the frame. Raises
        `console.link.WorkerGone`."""

    async def send_lag_test_order(self, begin: bool) -> Answer:
        """Begin or end the lag test, which measures while the state is calibrating. Raises as
        `send_order`."""


class FrameArrival:
    """Holds the newest frame and the time of its arrival."""

    def __init__(self) -> None:
        self.frame: Frame | None = None
        self._at_s = 0.0

    def take_frame(self, frame: Frame | None, now_s: float) -> bool:
        """Take the newest frame; return True if it differs from the former frame."""
        # A worker that was restarted counts from 0 again, so the time of the frame is compared too.
        if frame is None or (
            self.frame is not None and frame.seq == self.frame.seq and frame.at_s == self.frame.at_s
        ):
            return False
        self.frame, self._at_s = frame, now_s
        return True

    def calc_age_s(self, now_s: float) -> float:
        """Return the age of the frame, s; 0 before the first frame."""
        return 0.0 if self.frame is None else max(0.0, now_s - self._at_s)
