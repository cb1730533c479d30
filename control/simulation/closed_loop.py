"""How does a whole run go? Loop and plant closed on an injected clock, with the operator."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from topdress.control.loop import ControlLoop, Tick
from topdress.control.machine.model_elements import Array
from topdress.control.orders import Do, Order, State
from topdress.control.readings import (
    SENSED_COLUMNS,
    DriveCommand,
    Measurements,
    Reading,
    ValvePositions,
)
from topdress.control.targets.lag_correction import FiredChange

from .dose_watch import DoseWatch
from .plant import Plant, PlantTruth, SensorReadings
from .simulated_canopy import HeadRow


class MeasurementHold:
    """Keeps the newest readings of the plant's sensors for the loop, as the drivers do, but without
    encoding them as bytes. A sensor slower than the tick keeps its last reading."""

    def __init__(self, heads: int) -> None:
        self._now = Measurements(0.0, ndvi=(None,) * heads)

    def take_readings(self, s: SensorReadings) -> Measurements:
        t = s.time_s
        ndvi = self._now.ndvi if s.ndvi is None else tuple(Reading(v, t) for v in s.ndvi)
        readings: dict[str, Any] = {
            name: None if (value := getattr(s, name, None)) is None else Reading(value, t)
            for name in SENSED_COLUMNS
        }
        self._now = Measurements(
            t,
            s.gnss or self._now.gnss,
            ndvi=ndvi,
            work_switch=s.work_switch,
            plants=s.plants,
            speed_told=s.speed_told or self._now.speed_told,
            canopy_index=s.canopy_index,
            valves=None if s.valves_open is None else ValvePositions(t, s.valves_open),
            **readings,
        )
        return self._now


# Least mass of a refill that the operator reports, kg.
# Less is noise of the simulated scale.
MIN_REFILL_KG = 5.0


class SimulatedTick(NamedTuple):
    """Holds one tick of a simulated run: control's result, and what really happened."""

    tick: Tick
    truth: PlantTruth
    # Target for the ground at the outlet's present position, kg/ha.
    target_rate_kg_ha: float


def simulate_run(
    plant: Plant,
    loop: ControlLoop,
    seconds: float,
    orders: Sequence[tuple[float, Order]] | None = None,
    doses: DoseWatch | None = None,
) -> Iterator[SimulatedTick]:
    """Yields the ticks of a run, one every `plant.dt_s` for `seconds`.

    Parameters
    ----------
    orders : (time_s, order) of the operator; None: ready, start, and start again whenever a
        refill has held the work.
    doses : measures dose errors in point mode and reports them to the loop."""
    measuring = MeasurementHold(plant.machine.geometry.heads)
    # Orders are sorted, because each tick takes only those that are due.
    waiting = sorted(orders or (), key=lambda item: item[0])
    opening = plant.machine.set_points.opening_mm
    # The first readings come from a machine at rest.
    sensed = plant.advance_plant(DriveCommand(0.0, opening), False)
    operator = _SimulatedOperator() if orders is None else None
    for _ in range(round(seconds / plant.dt_s)):
        # Orders are handled before the tick, as the worker does.
        while waiting and waiting[0][0] <= sensed.time_s:
            loop.handle_order(waiting.pop(0)[1])
        tick = loop.run_tick(measuring.take_readings(sensed))
        if operator is not None:
            operator.act_on_tick(tick, plant.truth, loop.handle_order)
        # The target is that of the outlet's position, before the machine moves on.
        target = loop.find_target(tick.sensed.track_m)
        if doses is not None and tick.command.dose is not None and plant.truth is not None:
            doses.record_order(plant.truth.driven_m + loop.dose_ahead_m)
        sensed = plant.advance_plant(tick.command, tick.is_enabled)
        assert plant.truth is not None
        if doses is not None:
            # The measured error reaches the loop as an operator's order.
            for error_m in doses.take_step(plant.truth, tick.row.state == State.WORKING):
                loop.handle_order(Order(Do.DOSE_ERROR, round(error_m, 4)))
        yield SimulatedTick(tick, plant.truth, target.rate_kg_ha)


class _SimulatedOperator:
    """Starts when the machine moves, reports a refill, and starts again after it."""

    def __init__(self) -> None:
        self._wait_s = 0.0

    def act_on_tick(
        self, tick: Tick, truth: PlantTruth | None, order: Callable[[Order], object]
    ) -> None:
        now = tick.row.time_s
        state = tick.row.state
        if truth is not None and truth.refill_kg > MIN_REFILL_KG:
            order(Order(Do.REFILL, round(truth.refill_kg, 1)))
        if now < self._wait_s:
            return
        if state == State.OFF:
            order(Order(Do.READY))
        # The operator starts when the machine moves, so that no material heaps up at standstill.
        elif state in (State.READY, State.HELD) and (tick.sensed.speed_mps or 0.0) > 0.6:
            # An alarm that holds the work must be confirmed before READY.
            order(Order(Do.ACKNOWLEDGE, ""))
            if state == State.HELD:
                order(Order(Do.READY))
            order(Order(Do.START))
            # A second without orders lets the loop change its state.
            self._wait_s = now + 1.0


class RunRecord:
    """Records the columns by which a run is judged, a row for each tick."""

    RECORDED_COLUMNS = (
        "time_s",
        "shaft_rpm",
        "opening_mm",
        "flow_kg_s",
        "drop_s",
        "settled_drop_s",
        "driven_m",
        "speed_mps",
        "east_m",
        "north_m",
        "in_pass",
        "target_kg_ha",
        "working",
        "track_m",
        "shaft_rpm_cmd",
        "opening_mm_cmd",
        "flowing",
        "open_share",
        "carried_share",
        "heading_deg",
    )
    # NDVI of the canopy at the outlets, mean over the working width.
    COLUMN_NAMES = (*RECORDED_COLUMNS, "ndvi")

    # Rows are tuples, because an array of growing size would be copied each time.
    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []
        self._canopy: HeadRow | None = None
        self.fired: list[FiredChange] = []

    def add_tick(self, step: SimulatedTick) -> None:
        t = step.truth
        self._canopy = t.canopy
        self.fired.extend(step.tick.fired)
        self._rows.append(
            (
                t.time_s,
                t.shaft_rpm,
                t.opening_mm,
                t.flow_kg_s,
                t.drop_s,
                t.settled_drop_s,
                t.driven_m,
                t.speed_mps,
                t.east_m,
                t.north_m,
                float(t.in_pass),
                step.target_rate_kg_ha,
                float(step.tick.row.state == State.WORKING),
                step.tick.sensed.track_m,
                step.tick.command.shaft_rpm,
                step.tick.command.opening_mm,
                float(not step.tick.why_no_flow),
                t.open_share,
                t.carried_share,
                t.heading_deg,
            )
        )

    def make_columns(self) -> dict[str, Array]:
        table = np.array(self._rows, dtype=np.float64).reshape(-1, len(self.RECORDED_COLUMNS))
        found = {name: table[:, k] for k, name in enumerate(self.RECORDED_COLUMNS)}
        canopy = self._canopy
        found["ndvi"] = (
            np.zeros(len(table))
            if canopy is None
            else canopy.calc_means(found["east_m"], found["north_m"], found["heading_deg"])
        )
        return found
