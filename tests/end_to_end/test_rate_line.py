"""A target from another display over a real serial pair (pseudo-terminals): its cable pulled,
garbage, far too much, and what the ground got. `-s` prints the table."""

from __future__ import annotations

import os
import tty
from pathlib import Path

import pytest
from topdress.control.field.job import Wanted
from topdress.control.orders import Do, Order, TargetSource
from topdress.control.readings import Measurements
from topdress.control.simulation.assembly import make_control_loop
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.rate_line import RateLineDecoder, make_target_sentence
from topdress.drivers.ports import PortState

from tests.control_loop.closed import SETUP, STEP_S, Closed
from tests.waiting import wait_for

WANTED_KG_HA, SILENT_KG_HA = 200.0, 120.0
MOST_KG_HA = SETUP.crop.max_rate_kg_ha
RAVEN = b"$R,RC,2000,0\r\n"
TOO_MUCH = make_target_sentence(1000.0)
GARBAGE = (
    b"\x00\xff$R,RC,20a0\r\n$PTDRT,950.0*00\r\n$R,RC,99999999\r\n"
    b"$R,RC,-200\r\n\x80\x80$PTDRT,nan*11\r\n"
)


class Display:
    """The other end of the cable: one sentence five times a second."""

    def __init__(self, path: Path) -> None:
        self._path, self._master = path, -1
        self.plug()

    def plug(self) -> None:
        self._master, slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(slave)
        self._path.unlink(missing_ok=True)
        self._path.symlink_to(os.ttyname(slave))
        self._slave = slave

    def pull(self) -> None:
        os.close(self._master)
        os.close(self._slave)
        self._path.unlink()

    def say(self, data: bytes) -> None:
        os.write(self._master, data)


class Metering:
    """The machine at work by source external, the display at its cab's port."""

    def __init__(self, folder: Path) -> None:
        self.display = Display(folder / "display")
        self.now_s = 0.0
        self.cab = Cab(
            CabConfig.model_validate({"rate_line": {"port": str(folder / "display")}}),
            lambda: self.now_s,
        )
        job = SETUP.job.model_copy(
            update={
                "target": Wanted(source=TargetSource.EXTERNAL, external_silent_kg_ha=SILENT_KG_HA)
            }
        )
        self.closed = Closed(
            sim={"begin_m": 10.0, "passes": 1, "pass_length_m": 400.0}, target=job.target
        ).start()
        self._said = 0

    def run(self, seconds: float, data: bytes = b"") -> None:
        for k in range(round(seconds / STEP_S)):
            if data and k % 4 == 0:
                self.display.say(data)
                self._arrives(data.count(b"\n"))
            self.closed.tick(self._told)

    def _arrives(self, sentences: int) -> None:
        """Until the port's thread has them."""
        self._said += sentences
        wait_for(lambda: self.cab.read_measurements(self.now_s) and self._read >= self._said)

    def _told(self, m: Measurements) -> Measurements:
        self.now_s = m.time_s
        return m._replace(rate_asked=self.cab.read_measurements(m.time_s).rate_asked)

    @property
    def _read(self) -> int:
        return self.cab._devices["rate_line"].decoder.counts.read

    @property
    def connects(self) -> int:
        return self.cab._devices["rate_line"].line.port.state().connects

    def got_kg_ha(self, last_s: float) -> float:
        """What left the outlets, over the ground that passed."""
        truths = self.closed.truths[-round(last_s / STEP_S) :]
        kg, way_m = (
            sum(t.flow_kg_s for t in truths) * STEP_S,
            truths[-1].driven_m - truths[0].driven_m,
        )
        return 10_000.0 * kg / (SETUP.machine.geometry.working_width_m * way_m)


@pytest.mark.parametrize(
    ("what", "data", "pulled", "ground_kg_ha", "source", "alarm"),
    [
        ("the display goes on", RAVEN, False, WANTED_KG_HA, "external", None),
        ("its cable is pulled", b"", True, SILENT_KG_HA, "fallback", "target_silent"),
        ("garbage", GARBAGE, False, SILENT_KG_HA, "fallback", "target_silent"),
        ("1,000 kg/ha", TOO_MUCH, False, MOST_KG_HA, "external", "target_cut"),
        ("0 kg/ha", make_target_sentence(0.0), False, 0.0, "external", None),
    ],
)
def test_what_the_ground_gets_by_another_display(
    tmp_path, what, data, pulled, ground_kg_ha, source, alarm
):
    it = Metering(tmp_path)
    try:
        it.run(15.0, RAVEN)
        assert it.got_kg_ha(5.0) == pytest.approx(WANTED_KG_HA, rel=0.02)
        assert it.closed.ticks[-1].row.target_source == "external"
        if pulled:
            it.display.pull()
        it.run(1.7, data)
        before = it.closed.ticks[-1].row.target_source
        it.run(12.0, data)
        row, alarms = it.closed.ticks[-1].row, {one.id for one in it.closed.ticks[-1].alarms}
        print(
            f"{what}: after 1.7 s {before}, then {row.target_source}, "
            f"{it.got_kg_ha(5.0):.0f} kg/ha, "
            f"{', '.join(sorted(alarms)) or 'no alarm'}"
        )
        assert row.target_source == source and before == "external"
        assert it.got_kg_ha(5.0) == pytest.approx(ground_kg_ha, rel=0.02, abs=0.1)
        assert (alarm is None and not alarms) or alarm in alarms
        if pulled:
            it.display.plug()
            wait_for(lambda: it.cab.read_measurements(it.now_s) and it.connects == 2)
            it._said = it._read
            it.run(10.0, RAVEN)
            assert it.got_kg_ha(4.0) == pytest.approx(WANTED_KG_HA, rel=0.02), "plugged again"
    finally:
        it.cab.close_devices()


class Silent:
    """A line whose other end says what it is given, and hears what is written."""

    def __init__(self) -> None:
        self.waiting, self.written = b"", b""

    def read(self) -> bytes:
        said, self.waiting = self.waiting, b""
        return said

    def write(self, data: bytes) -> None:
        self.written += data

    def state(self) -> PortState:
        return PortState(True, 1, "", 0, 0, 0, 0, None, b"")

    def close(self) -> None:
        pass


@pytest.mark.exam
def test_record_only_moves_no_drive_and_logs_and_counts_what_another_controller_does(tmp_path):
    """Somebody else's controller spreads 300 kg/ha and tells it; this one listens."""
    lines = {"board": Silent(), "rates": Silent()}
    config = CabConfig.model_validate(
        {
            "record_only": True,
            "board": {"port": "socket://board:1"},
            "rate_line": {"port": "socket://rates:1"},
        }
    )
    cab = Cab(config, lambda: 0.0, lambda url, *_: lines[url.split("/")[2].split(":")[0]])
    target = Wanted(source=TargetSource.MANUAL, manual_rate_kg_ha=300.0)
    theirs = Closed(
        sim={"begin_m": 10.0, "passes": 1, "pass_length_m": 400.0}, target=target
    ).start()
    ours = make_control_loop(SETUP.machine, SETUP.crop, SETUP.rule, theirs.job, record_only=True)
    assert [ours.handle_order(Order(do)).why for do in (Do.READY, Do.START, Do.CALIBRATE)] == [
        "record_only"
    ] * 3
    rows = []
    for k in range(800):
        row = theirs.tick().row
        if k % 4 == 0 and row.applied_rate_kg_ha is not None:
            lines["rates"].waiting = b"$R114-,AR,%d\r\n" % round(10.0 * row.applied_rate_kg_ha)
        heard = cab.read_measurements(row.time_s)
        m = theirs._measuring._now
        tick = ours.run_tick(
            m._replace(
                rate_applied=heard.rate_applied, shaft_rpm=None, opening_mm=None, hopper_kg=None
            )
        )
        cab.send_command(row.time_s, tick.command, tick.is_enabled)
        cab.give_dose(row.time_s, 120.0, 70.0)
        rows.append(tick.row)
    cab.close_devices()
    assert lines["board"].written == b"" and not tick.is_enabled and tick.command.shaft_rpm == 0.0
    last = rows[-1]
    assert last.applied_rate_kg_ha == pytest.approx(300.0, rel=0.05)
    assert (last.state, last.shaft_rpm_cmd, last.opening_mm_cmd) == (None, None, None)
    assert tick.verdict.why_state == "record_only", "what the console says in place of a state"
    kg, ours_kg = theirs.loop.totals.applied_kg, ours.totals.applied_kg
    print(
        f"record only: 0 bytes to the board; {ours.totals.area_ha:.4f} ha and {ours_kg:.2f} "
        "kg logged, "
        f"{theirs.loop.totals.area_ha:.4f} ha and {kg:.2f} kg spread"
    )
    assert ours_kg == pytest.approx(kg, rel=0.02) and ours.totals.covered_ha == pytest.approx(
        theirs.loop.totals.covered_ha, rel=0.1
    )
    assert not any(row.alarms and "shaft_turns" in row.alarms for row in rows)


def test_a_raven_target_counts_once_it_came_twice_and_no_spoilt_line_is_one():
    decoder = RateLineDecoder()
    said = [
        one.rate_kg_ha
        for one in decoder.feed(b"$R,RC,2000\r\n$R,RC,9000\r\n$R,RC,2000\r\n$R,RC,2000\r\n", 1.0)
    ]
    assert said == [200.0] and decoder.counts.ignored["said_once"] == 3
    assert [one.rate_kg_ha for one in decoder.feed(make_target_sentence(130.0), 2.0)] == [130.0]
    assert decoder.feed(GARBAGE, 3.0) == [] and sum(decoder.counts.rejected.values()) == 5
    actual = decoder.feed(b"$R114-,AR,1287,0,0\r\n", 4.0)
    assert [(one.rate_kg_ha, one.is_target) for one in actual] == [(pytest.approx(128.7), False)]
