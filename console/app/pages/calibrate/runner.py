"""Runs shaft and gate while a key or button is held: orders out, repeated, and a release the moment it is let go."""
from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence

from console.app import words
from console.app.held_key import HeldKey
from console.locale import _
from control.orders import Answer, Do, Order

REPEAT_S = 0.1                # the control worker stops 0.5 s after the last one

Give = Callable[[Order], Awaitable[Answer]]
Start = Callable[[Awaitable[None]], object]


class Runner:
    """give: sends one order and waits for its answer. start: runs a coroutine in the background."""

    def __init__(self, give: Give, start: Start) -> None:
        self.held = HeldKey()
        self.said = ""                # why it does not run, in words
        self._give, self._start = give, start
        self._running = False
        self._sent_s = -REPEAT_S

    def key(self, now_s: float) -> None:
        self.held.key(now_s)
        if self.held.armed:
            self.said = _("Keep it pressed: the shaft turns while the key or the mouse button is down.")

    def mouse(self, down: bool) -> None:
        self.held.mouse(down)

    def let_go(self, now_s: float, settings: Sequence[Order] = ()) -> None:
        self.held.let_go()
        self.tick(now_s, settings)

    def tick(self, now_s: float, settings: Sequence[Order]) -> None:
        """Send what is due; settings: orders for shaft and gate at the beginning of a run."""
        if not self.held.down(now_s):
            if self._running:
                self._running = False
                self._start(self._end())
        elif not self._running:
            self._running, self._sent_s, self.said = True, now_s, ""
            self._start(self._begin(tuple(settings), now_s))
        elif now_s - self._sent_s >= REPEAT_S - 1e-3:
            self._sent_s = now_s
            self._start(self._repeat(now_s))

    async def _begin(self, settings: tuple[Order, ...], now_s: float) -> None:
        for order in (Order(Do.CALIBRATE), *settings):
            if not self._running or not self._kept(await self._give(order), now_s):
                return

    async def _repeat(self, now_s: float) -> None:
        if self._running:
            self._kept(await self._give(Order(Do.CALIBRATE)), now_s)

    async def _end(self) -> None:
        await self._give(Order(Do.RELEASE))

    def _kept(self, answer: Answer, now_s: float) -> bool:
        """A refusal ends the run; a late answer does not, the worker's own watch decides."""
        if answer.accepted or answer.why == "no_answer":
            return True
        if self._running:
            self._running = False
            self.said = words.answer_words(answer.why)
            self.held.block(now_s)
            self._start(self._end())
        return False
