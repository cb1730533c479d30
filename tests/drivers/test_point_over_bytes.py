"""Doses from the loop's command over the cab's bytes to the virtual board, and its reports back."""
from __future__ import annotations

import pytest

from control.readings import DoseOrder, DriveCommand
from drivers.cab import Cab, CabConfig
from drivers.devices.point_dose import DoseState
from drivers.ports import memory_pair
from drivers.virtual.board import VirtualBoard

DOSE = DoseOrder(120.0, 99.8)
STANDING = DriveCommand(0.0, 25.0)


class Bench:
    """A cab and a virtual board on one line, stepped together every 50 ms."""

    def __init__(self, clock) -> None:
        host, self.end = memory_pair("board", clock)
        self.cab = Cab(CabConfig.model_validate({"board": {"port": "b"}}), clock, lambda *_: host)
        self.board = VirtualBoard(25.0)
        self.clock = clock
        self.begun: list[DoseOrder] = []
        self.orders: dict[int, DriveCommand] = {}

    def run(self, ticks: int, enabled: bool = True, doses: dict[int, DoseOrder] | None = None) -> None:
        for tick in range(ticks):
            now_s = self.clock.now_s
            self.cab.measure(now_s)
            self.cab.command(now_s, STANDING._replace(dose=(doses or {}).get(tick)), enabled)
            self.board.feed(self.end.read(), now_s)
            begins = self.board.dose(now_s)
            self.begun += [] if begins is None else [begins]
            self.end.write(self.board.status(sensed(now_s), now_s))
            self.clock.now_s += 0.05


def sensed(now_s: float):
    from control.simulation.plant import SensorReadings
    return SensorReadings(now_s, None, 0.0, 0, None, 0.0, 25.0, 100.0, 13.5, 0.0, 0.0, None)


@pytest.fixture
def bench(clock) -> Bench:
    made = Bench(clock)
    made.run(2, enabled=False)
    made.run(2)
    return made


def test_a_commanded_dose_reaches_the_board_once_and_is_reported_done(bench):
    bench.run(10, doses={0: DOSE})
    assert bench.begun == [DOSE]
    dose = bench.cab.dose
    assert dose is not None and dose.state is DoseState.DONE and dose.turned_deg == 120.0
    assert dose.took_s == pytest.approx(0.2004, abs=1e-3)
    assert not bench.board.counts.rejected


def test_a_dose_that_comes_too_soon_waits_for_the_one_before_or_is_dropped_and_counted(bench):
    bench.run(12, doses={0: DOSE, 4: DOSE})
    assert len(bench.begun) == 2 and bench.cab.dropped_doses == 0
    bench.run(12, doses={0: DOSE, 1: DOSE})
    assert len(bench.begun) == 3 and bench.cab.dropped_doses == 1


def test_a_stop_ends_the_dose_and_one_that_waits(bench):
    bench.run(5, doses={0: DoseOrder(720.0, 99.8), 4: DOSE})
    bench.run(3, enabled=False)
    dose = bench.cab.dose
    assert dose is not None and dose.state is DoseState.ABORTED and 60.0 < dose.turned_deg < 250.0
    bench.run(10)
    assert len(bench.begun) == 1, "nothing is given by itself afterwards"
    bench.run(1, enabled=False, doses={0: DOSE})
    assert len(bench.begun) == 1


def test_a_board_asked_too_much_refuses(bench):
    word = bench.board.word
    bench.board.feed(frame(f"D3,900,1,720.000,99.800,{word}"), bench.clock.now_s)
    bench.board.feed(frame(f"D3,901,2,120.000,99.800,{word}"), bench.clock.now_s)
    assert b"E1," in bench.board.status(sensed(bench.clock.now_s), bench.clock.now_s)
    assert b",2,3,0.000," in bench.board.status(sensed(bench.clock.now_s), bench.clock.now_s)
    bench.board.feed(frame(f"D3,901,2,120.000,99.800,{word}"), bench.clock.now_s)
    assert bench.board.counts.rejected["repeated_sequence"] == 1


def test_a_dose_of_another_session_is_not_given_and_stops_the_board(bench):
    bench.board.feed(frame("D1,900,1,720.000,99.800"), bench.clock.now_s)
    assert bench.board.counts.rejected["old_order"] == 1 and not bench.board.set_points(bench.clock.now_s)[1]
    bench.run(3)
    assert bench.begun == [] and bench.cab.measure(bench.clock.now_s).old_orders


def frame(payload: str) -> bytes:
    from drivers.board.framing import seal
    return seal(payload)
