"""What is on its way from the roller to the ground, as far as the commands given so far decide it.

Where all that falls moves at the pace of the shaft speed of the moment (`machine.landing.carried_s`) a parcel lands
when the integral of dt / drop(n(t)) since its release is 1. That integral is the `way` here. It is known ahead for as
long as the shaft takes to answer: the speeds of the next 0.4 s are commanded already. Where granules keep a part of
their own pace (`machine.landing.falls_s`) only the rest of their way is gone with the stream.
"""
from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import inf
from typing import NamedTuple

from control.machine.fall import Fall, drop_s

SHORTEST_S = 0.05           # a drop time of nothing
KEPT_S = 2.0                # of the past, that a landing time may still be asked for


class Turning(NamedTuple):
    """From `from_s` on the shaft turns with `rpm`; the way begins this piece at `way`."""

    from_s: float
    rpm: float
    pace_per_s: float
    way: float


class Parcel(NamedTuple):
    """What is released from `way` on, with the number that whoever released it wants to know when it lands."""

    way: float
    note: float


class Tube:
    """One of a machine. `answers_s`: from a command to the shaft, dead time and time constant."""

    def __init__(self, fall: Fall, answers_s: float, rpm: float = 0.0) -> None:
        self._fall = fall
        self.answers_s = answers_s
        self._pieces = [Turning(0.0, rpm, self._pace(rpm), 0.0)]        # as if for ever
        self._begins = [0.0]
        self._parcels: deque[Parcel] = deque()

    def command(self, now_s: float, rpm: float) -> None:
        """The shaft is commanded a true speed at `now_s`; times rise."""
        last = self._pieces[-1]
        if rpm == last.rpm:
            return
        begins = max(now_s + self.answers_s, last.from_s)
        way = last.way + (begins - last.from_s) * last.pace_per_s
        self._pieces.append(Turning(begins, rpm, self._pace(rpm), way))
        self._begins.append(begins)
        while len(self._begins) > 2 and self._begins[1] < now_s - KEPT_S:
            del self._begins[0], self._pieces[0]

    def rpm_at(self, time_s: float) -> float:
        return self._pieces[max(0, bisect_right(self._begins, time_s) - 1)].rpm

    def way_at(self, time_s: float) -> float:
        """Way of the stream at a time; the last commanded speed goes on."""
        piece = self._pieces[max(0, bisect_right(self._begins, time_s) - 1)]
        return piece.way + (time_s - piece.from_s) * piece.pace_per_s

    def lands_s(self, released_s: float) -> float:
        """When what is released at a time lands, if the last commanded shaft speed goes on."""
        share = self._fall.carried_share
        if share >= 1.0:
            there = self.way_at(released_s) + 1.0
            piece = next((one for one in reversed(self._pieces) if one.way <= there), self._pieces[0])
            return piece.from_s + (there - piece.way) / piece.pace_per_s
        own = (1.0 - share) * self._pieces[max(0, bisect_right(self._begins, released_s) - 1)].pace_per_s
        left, at_s = 1.0, released_s
        for piece, ends_s in zip(self._pieces, [*self._begins[1:], inf], strict=True):
            if ends_s <= at_s:
                continue
            pace = own + share * piece.pace_per_s
            if left <= pace * (ends_s - at_s):
                break
            left -= pace * (ends_s - at_s)
            at_s = ends_s
        return at_s + left / pace

    def release(self, released_s: float, note: float) -> None:
        """Note what is released from then on."""
        way = self.way_at(released_s)
        while self._parcels and self._parcels[-1].way >= way:
            self._parcels.pop()
        self._parcels.append(Parcel(way, note))

    def landing(self, time_s: float) -> float | None:
        """The note of what lands at a time where the stream carries all; earlier parcels are forgotten. None: nothing
        is known of it."""
        way = self.way_at(time_s) - 1.0
        while len(self._parcels) > 1 and self._parcels[1].way <= way:
            self._parcels.popleft()
        return self._parcels[0].note if self._parcels and self._parcels[0].way <= way else None

    def empty(self) -> None:
        """Nothing more is known of what falls: flow has stopped."""
        self._parcels.clear()

    def _pace(self, rpm: float) -> float:
        return 1.0 / max(SHORTEST_S, drop_s(self._fall, rpm))
