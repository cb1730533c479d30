"""What a drive that does not stop when commanded to costs, and when it is said: `python -m
benchmarks drives_disobey`

Worker's loop, cab and drivers against the virtual machine's bytes, on an injected clock. In
each state the board turns the shaft at 70 r/min for 30 s, whatever the command; or opens the
gate; or a section's valve stays open. Printed: what left the machine (plant), what the console
counted, what the log's events tell, and after how many seconds it was said.

Then (alone: `scale`) what shaft and scale say of each other: faults of the scale, of the
shaft's reading, an outlet. Printed: what the ground got of what was wanted, by the plant, and
when which alarm was said. The operator acknowledges what holds the work, and starts again after
`BIND_RETRY_S`. `healthy SEED HOURS`: how many alarms a sound machine has.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import pi, sin
from typing import NamedTuple

from rig import DAY, DT_S, Rig
from topdress.control.orders import Do, Order, TargetSource
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import simulate_run
from topdress.control.simulation.compiled_steps import COMPILED_STEPS
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.files.run_setup import load_setup
from topdress.drivers.virtual.faults import RUNAWAY_OPENING_MM, RUNAWAY_SHAFT_RPM, DriveRunaway
from verdict import exit_code

LASTS_S = 30.0
SETTLED_S = 5.0  # after the shaft has come to a stand again
SHAFT_SAID_S, GATE_SAID_S, VALVE_SAID_S = 1.2, 2.0, 5.0  # at the latest
APART_SHARE = 0.02  # counted against plant


class Lie(NamedTuple):
    """What shaft and scale do not say as it is, from `at_s` on."""

    # (kg, kg at at_s, seconds since) -> kg
    reads: Callable[[float, float, float], float] = lambda kg, full_kg, s: kg
    turns: float = 1.0  # times what the shaft is commanded
    says: float = 1.0  # times what the shaft turns
    effects: tuple[str, ...] = ()
    at_s: float = 0.0

    def lie(self) -> Callable[[SensorReadings], SensorReadings]:
        full_kg: list[float] = []

        def sensed_as(sensed: SensorReadings) -> SensorReadings:
            if sensed.time_s < self.at_s:
                return sensed
            full_kg.append(sensed.hopper_kg)
            return sensed._replace(
                shaft_rpm=self.says * sensed.shaft_rpm,
                hopper_kg=self.reads(sensed.hopper_kg, full_kg[0], sensed.time_s - self.at_s),
            )

        return sensed_as


class ReadsZero:
    """A shaft that is read as standing from some time on."""

    on = False

    def __call__(self, sensed: SensorReadings) -> SensorReadings:
        return sensed._replace(shaft_rpm=0.0) if self.on else sensed


WORK = "work"
Step = str | float | Do | tuple[Do, object]


def led(*steps: Step) -> Callable[[Rig], None]:
    """Work, seconds that pass, and orders, in turn."""

    def lead(it: Rig) -> None:
        for step in steps:
            if step == WORK:
                it.work()
            elif isinstance(step, float):
                it.run(step)
            else:
                it.order(*(step if isinstance(step, tuple) else (step,)))  # type: ignore[arg-type]

    return lead


def switch_up(it: Rig) -> None:
    it.work()
    it.switch_up = True


def fault(it: Rig) -> None:
    it.work()
    it.virtual.board.driver_fault = True
    it.run(5.0)


CALIBRATING = "calibrating, shaft at 0"
STATES: dict[str, Callable[[Rig], None]] = {
    "off, from the start": led(2.0),
    "ready": led(2.0, Do.READY, 2.0),
    CALIBRATING: led(2.0, Do.READY, 2.0, Do.CALIBRATE, 0.2),
    "held, from the order on": led(WORK, Do.HOLD),
    "held, later": led(WORK, Do.HOLD, 5.0),
    "off, from STOP on": led(WORK, Do.STOP),
    "working, switch up": switch_up,
    "working, rate 0": led(WORK, (Do.MANUAL_RATE, 0.0), (Do.SOURCE, TargetSource.MANUAL.value)),
    "fault": fault,
}


class Found(NamedTuple):
    plant_kg: float
    counted_kg: float
    entered_kg: float
    said_s: float | None
    # frames with shaft 0 that the board took, a second
    zeros_hz: float
    state: str  # after the alarm


def lied_to(
    begin: Callable[[Rig], None],
    runaway: DriveRunaway,
    alarm: str,
    machine: str = "huanghai",
    job: str = "demo",
    stuck: dict[int, bool] | None = None,
) -> Found:
    reads = ReadsZero()
    it = Rig(machine, job, lie=reads)
    begin(it)
    reads.on = alarm == "flow_unordered"
    first, from_kg, counted_kg, frames = (
        len(it.ticks),
        it.hopper_kg,
        it.loop.totals.applied_kg,
        it.virtual.board.counts.accepted,
    )
    if stuck and it.plant.valves is not None:
        it.plant.valves.stuck = stuck
    it.runaway = runaway
    holds = (
        (lambda: it.loop.handle_order(Order(Do.CALIBRATE)))
        if begin is STATES[CALIBRATING]
        else (lambda: None)
    )
    tick = it.run(LASTS_S, holds)
    zeros_hz = (it.virtual.board.counts.accepted - frames) / LASTS_S
    state = str(tick.row.state)
    it.runaway = DriveRunaway()
    it.run(SETTLED_S)
    said = [k for k, one in enumerate(it.ticks[first:]) if alarm in {a.id for a in one.alarms}]
    entered = sum(
        float(event.split()[1])
        for one in it.ticks[first:]
        for event in (one.row.events or "").split(";")
        if event.startswith("released_stopped")
    )
    assert (
        all(one.command.shaft_rpm == 0.0 for one in it.ticks[first + 1 :]) or alarm == "valve_open"
    )
    return Found(
        from_kg - it.hopper_kg,
        it.loop.totals.applied_kg - counted_kg,
        entered,
        (said[0] + 1) * DT_S if said else None,
        zeros_hz,
        state,
    )


def promised(who: str, found: Found, said_s: float) -> dict[str, object]:
    apart_kg = abs(found.counted_kg - found.plant_kg)
    return {
        f"{who}: said after {found.said_s} s: at most {said_s:g}": found.said_s is not None
        and found.said_s <= said_s,
        f"{who}: {found.counted_kg:.2f} kg counted of {found.plant_kg:.2f}: within "
        f"{APART_SHARE:.0%} and 20 g": apart_kg <= APART_SHARE * found.plant_kg + 0.02,
        f"{who}: set-point zero at {found.zeros_hz:.0f} Hz: at least 10": found.zeros_hz >= 10.0,
    }


# of a fault in the middle of the work, counted from the simulation's start
BEGINS_S = 100.0
WORKS_S, AGAIN_S = 300.0, 5.0
# a scale alone may move the dose by no more, in the mean of the run
GROUND_PERCENT = 10.0

LIES: dict[str, tuple[Lie, tuple[str, ...]]] = {
    "healthy": (Lie(), ()),
    "scale reads 30 % less": (Lie(effects=("scale.gain=-30",)), ("flow_disagrees",)),
    "scale reads 30 % more": (Lie(effects=("scale.gain=30",)), ("flow_disagrees",)),
    "scale binds at 60 % of the fall": (
        Lie(lambda kg, full, s: full - 0.6 * (full - kg)),
        ("flow_disagrees",),
    ),
    "scale frozen": (Lie(lambda kg, full, s: full, at_s=BEGINS_S), ("flow_missing",)),
    "filled at 0.1 kg/s for 60 s": (
        Lie(lambda kg, full, s: kg + 0.1 * min(s, 60.0), at_s=BEGINS_S),
        ("flow_missing",),
    ),
    "sways by 1 kg in 30 s": (Lie(lambda kg, full, s: kg + sin(2.0 * pi * s / 30.0)), ()),
    "sways so from 100 s on": (
        Lie(lambda kg, full, s: kg + sin(2.0 * pi * s / 30.0), at_s=BEGINS_S),
        (),
    ),
    "one outlet of six blocked": (
        Lie(effects=(f"flow.blocked_outlet={100.0 / 6.0:.3f}@{BEGINS_S:g}",)),
        ("outlet_blocked",),
    ),
    **{
        f"shaft reads as commanded, turns x {k:g}": (
            Lie(turns=k, says=1.0 / k, at_s=BEGINS_S),
            (alarm,),
        )
        for k, alarm in ((0.25, "flow_missing"), (0.5, "flow_disagrees"), (2.0, "flow_above"))
    },
    **{
        f"shaft reads x {k:g}, turns as commanded": (Lie(says=k, at_s=BEGINS_S), ())
        for k in (0.25, 0.5, 0.82, 2.0)
    },
}


def lied(lie: Lie) -> tuple[float, float, dict[str, float]]:
    """Share of the wanted mass that the plant gave from the fault on, how many kg that is off,
    and what was said after how many seconds of it (of work, where it was there all along)."""
    it = Rig(
        lie=lie.lie(),
        turns=lambda at_s: lie.turns if at_s >= lie.at_s else 1.0,
        effects=lie.effects,
    )
    said: dict[str, float] = {}
    given_kg = wanted_kg = begins_s = 0.0

    def at_work() -> None:
        nonlocal given_kg, wanted_kg
        truth, tick = it.plant.truth, it.ticks[-1] if it.ticks else None
        if tick is None or truth is None or it.now_s < begins_s:
            return
        for alarm in tick.alarms:
            said.setdefault(alarm.id, it.now_s - begins_s)
        if tick.row.state == "working" and not tick.why_no_flow and tick.row.target_rate_kg_ha:
            given_kg += truth.flow_kg_s * DT_S
            wanted_kg += tick.row.target_rate_kg_ha * 2.4 * truth.speed_mps / 10_000.0 * DT_S

    it.run(2.0)
    it.order(Do.READY)
    it.run(3.0)
    it.order(Do.START)
    begins_s = max(lie.at_s, it.now_s, *(BEGINS_S for text in lie.effects if "blocked" in text))
    while it.now_s < WORKS_S:
        tick = it.run(AGAIN_S, at_work)
        if tick.row.state in ("held", "fault"):
            it.order(Do.ACKNOWLEDGE, "")
            if tick.row.state == "fault":
                it.loop.handle_order(Order(Do.READY))
            it.loop.handle_order(Order(Do.START))
    return given_kg / max(1e-9, wanted_kg), given_kg - wanted_kg, said


RED_OF_FLOW = ("flow_missing", "flow_above", "flow_disagrees", "outlet_blocked", "flow_unordered")


def scale() -> dict[str, object]:
    promises: dict[str, object] = {}
    print("| fault | the ground got | kg off | said, after s |\n|---|---|---|---|")
    for name, (lie, red) in LIES.items():
        share, off_kg, said = lied(lie)
        words = (
            ", ".join(f"{one} {s:.0f}" for one, s in sorted(said.items(), key=lambda pair: pair[1]))
            or "nothing"
        )
        print(f"| {name} | {100.0 * (share - 1.0):+.1f} % | {off_kg:+.1f} | {words} |", flush=True)
        promises[f"{name}: {', '.join(red) or 'no red alarm of the flow'}"] = (
            all(one in said for one in red) if red else not any(one in said for one in RED_OF_FLOW)
        ) or "reads x" in name
        if lie.turns == 1.0 and lie.says == 1.0:
            promises[f"{name}: the good outlets within {GROUND_PERCENT:g} %"] = (
                abs(share * (1.2 if "blocked" in name else 1.0) - 1.0) < 0.01 * GROUND_PERCENT
            )
    print(
        "\n| shaft turns at 70 r/min for 30 s and reads 0 | kg by the plant | counted | in "
        "events | said after s | "
        "state then |\n|---|---|---|---|---|---|"
    )
    for name, begin in {
        "off for 2 s": led(2.0),
        "off for 60 s": led(60.0),
        "ready": STATES["ready"],
        "held": STATES["held, later"],
    }.items():
        found = lied_to(begin, DriveRunaway(shaft_rpm=RUNAWAY_SHAFT_RPM), "flow_unordered")
        after = "never" if found.said_s is None else f"{found.said_s:.1f}"
        print(
            f"| {name} | {found.plant_kg:.2f} | {found.counted_kg:.2f} | "
            f"{found.entered_kg:.2f} | {after} | "
            f"{found.state} |",
            flush=True,
        )
        promises[f"{name}: said"] = found.said_s is not None
        promises[f"{name}: counted within 0.5 kg"] = abs(found.counted_kg - found.plant_kg) < 0.5
    return promises


def healthy(seed: int, hours: float) -> dict[str, object]:
    """A sound machine on slopes, with refills, straight from the plant: which alarms, and how
    far the scale trims."""
    setup = load_setup("huanghai", "demo", DAY)
    job = setup.job.model_copy(
        update={
            "simulated": setup.job.simulated.model_copy(
                update={"passes": 400, "slope_deg": 4.0 * (seed % 2), "refill_at_kg": 40.0}
            )
        }
    )
    job = add_simulated_field(job, setup.machine)
    plant = make_plant(setup.machine, job, seed, DT_S, steps=COMPILED_STEPS)
    said: dict[str, int] = {}
    most, before = 0.0, frozenset[str]()
    for step in simulate_run(
        plant,
        make_control_loop(setup.machine, setup.crop, setup.rule, job, steps=COMPILED_STEPS),
        3600.0 * hours,
    ):
        now = frozenset(alarm.id for alarm in step.tick.alarms)
        for new in now - before:
            said[new] = said.get(new, 0) + 1
        before, most = now, max(most, abs((step.tick.row.flow_trim or 1.0) - 1.0))
    print(
        f"| {seed} | {hours:g} h, slope {job.simulated.slope_deg:g} deg | {100 * most:.1f} "
        f"% | {said or 'nothing'} |",
        flush=True,
    )
    return {
        f"seed {seed}: no alarm of the flow": not set(said)
        & {*RED_OF_FLOW, "scale_unexplained", "flow_trimmed"}
    }


def main() -> int:
    if sys.argv[1:2] == ["scale"]:
        return exit_code(scale())
    if sys.argv[1:2] == ["healthy"]:
        return exit_code(healthy(int(sys.argv[2]), float(sys.argv[3])))
    promises: dict[str, object] = {}
    print(
        "| drive | state | kg by the plant | kg counted | kg in the log's events | said "
        "after s | zeros a s | state "
        "then |\n|---|---|---|---|---|---|---|---|"
    )

    def show(drive: str, name: str, found: Found, said_s: float) -> None:
        after = "never" if found.said_s is None else f"{found.said_s:.2f}"
        kg = f"{found.plant_kg:.2f} | {found.counted_kg:.2f} | {found.entered_kg:.2f}"
        print(
            f"| {drive} | {name} | {kg} | {after} | {found.zeros_hz:.0f} | {found.state} |",
            flush=True,
        )
        promises.update(promised(f"{drive}, {name}", found, said_s))

    for name, begin in STATES.items():
        show(
            "shaft turns",
            name,
            lied_to(begin, DriveRunaway(shaft_rpm=RUNAWAY_SHAFT_RPM), "shaft_turns"),
            SHAFT_SAID_S,
        )
    for name in (
        "off, from the start",
        "ready",
        "held, from the order on",
        "working, switch up",
        "fault",
    ):
        show(
            "gate opens",
            name,
            lied_to(STATES[name], DriveRunaway(opening_mm=RUNAWAY_OPENING_MM), "gate_opens"),
            GATE_SAID_S,
        )
    for name in ("off, from the start", "ready", "held, from the order on", "working, switch up"):
        show(
            "valve 2 open",
            name,
            lied_to(
                STATES[name],
                DriveRunaway(),
                "valve_open",
                "huanghai_sections",
                "sections_demo",
                {2: True},
            ),
            VALVE_SAID_S,
        )
    return exit_code(promises | scale())


if __name__ == "__main__":
    sys.exit(main())
