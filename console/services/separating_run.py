"""How is the run that separates rival causes driven on the simulated machine and written as a job
file?
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from topdress.control.experiments.setting_levels import list_opening_levels, list_shaft_levels
from topdress.control.field.job import Job, SpeedChange
from topdress.control.machine.machine import Machine
from topdress.control.orders import Do, Order, TargetSource

TimedOrders = tuple[tuple[float, Order], ...]

# Interval at which the calibration button is reported as pressed, s.
CONFIRM_PERIOD_S = 0.2
# Number of repetitions of a setting's command.
SETTING_REPEATS = 10
# Safety ends a calibration run at 120 s.
CALIBRATING_RUN_S = 118.0
# Rate of the driven runs, kg/ha.
DRIVEN_RATE_KG_HA = 300.0
# Time by which the tractor moves, s.
DRIVE_BEGIN_S = 4.0
# Flow for about 300 kg/ha at 4.5 km/h and 2.4 m, kg/s.
BENCH_FLOW_KG_S = 0.09


class SeparatingDrive(NamedTuple):
    """Holds a run to drive. `orders` None means the simulated operator's own orders (ready, start,
    start again after a refill)."""

    job: Job
    seconds: float
    orders: TimedOrders | None


def is_drivable(run_id: str) -> bool:
    """Returns whether the simulated machine can drive the manoeuvre that a diagnosis planned."""
    return run_id in _DRIVE_MAKERS


def make_drive(manoeuvre: str, job: Job, machine: Machine) -> SeparatingDrive:
    """Returns a manoeuvre on the ground of `job`, with a fixed rate and without the scale's trim,
    so that nothing else changes.

    Raises ValueError for a manoeuvre that the simulated machine cannot drive.
    """
    if manoeuvre not in _DRIVE_MAKERS:
        raise ValueError(f"{manoeuvre}: the simulated machine cannot drive this run")
    target = job.target.model_copy(
        update={
            "source": TargetSource.MANUAL,
            "manual_rate_kg_ha": DRIVEN_RATE_KG_HA,
            "map": None,
            "plants": None,
            "index_map": None,
            "hold_mean_kg_ha": None,
        }
    )
    calm = job.model_copy(
        update={
            "id": f"separate_{manoeuvre}",
            "target": target,
            "flow_trim": False,
            "field": job.field.model_copy(update={"boundary_m": (), "holes_m": (), "done": None}),
        }
    )
    return _DRIVE_MAKERS[manoeuvre](calm, machine)


def _change_simulated(job: Job, **simulated: object) -> Job:
    return job.model_copy(update={"simulated": job.simulated.model_copy(update=simulated)})


def _make_standing_job(job: Job) -> Job:
    return _change_simulated(
        job, speed_changes=(SpeedChange(at_s=0.0, speed_kmh=0.0),), refill_at_kg=0.0
    )


def _make_bench_orders(settings: list[tuple[float, float]]) -> TimedOrders:
    """Returns calibration runs of two settings, a minute each, which is as long as safety
    permits."""
    orders: list[tuple[float, Order]] = [(1.0, Order(Do.READY))]
    for pair in range(0, len(settings), 2):
        begin = 5.0 + 61.0 * pair
        ticks = [
            begin + CONFIRM_PERIOD_S * k for k in range(int(CALIBRATING_RUN_S / CONFIRM_PERIOD_S))
        ]
        orders += [(at, Order(Do.CALIBRATE, 120.0)) for at in ticks]
        for k, (rpm, mm) in enumerate(settings[pair : pair + 2]):
            # The command is repeated, because the noise of the speed forbids the begin at times.
            for again in range(SETTING_REPEATS):
                at = begin + 0.1 + 59.0 * k + CONFIRM_PERIOD_S * again
                orders += [
                    (at, Order(Do.CALIBRATE_OPENING, mm)),
                    (at + 0.1, Order(Do.CALIBRATE_SHAFT, rpm)),
                ]
    return tuple(sorted(orders, key=lambda one: one[0]))


def _make_two_speed_drive(job: Job, machine: Machine) -> SeparatingDrive:
    changes = tuple(
        SpeedChange(at_s=120.0 * k, speed_kmh=3.0 if k % 2 == 0 else 6.0) for k in range(5)
    )
    return SeparatingDrive(
        _change_simulated(job, speed_changes=changes, refill_at_kg=0.0), 600.0, None
    )


def _make_out_of_work_drive(job: Job, machine: Machine) -> SeparatingDrive:
    orders = [(1.0, Order(Do.READY)), (DRIVE_BEGIN_S + 2.0, Order(Do.START))]
    for minute in range(1, 10):
        orders.append((60.0 * minute, Order(Do.HOLD if minute % 2 else Do.START)))
    return SeparatingDrive(_change_simulated(job, refill_at_kg=0.0), 600.0, tuple(orders))


def _make_refill_drive(job: Job, machine: Machine) -> SeparatingDrive:
    empty_kg = machine.flow.full_kg / 3.0
    begin_kg = empty_kg + 600.0 * BENCH_FLOW_KG_S
    return SeparatingDrive(
        _change_simulated(job, hopper_kg=begin_kg, refill_at_kg=empty_kg), 1260.0, None
    )


_DRIVE_MAKERS: dict[str, Callable[[Job, Machine], SeparatingDrive]] = {
    "stairs": lambda job, machine: SeparatingDrive(
        _make_standing_job(job),
        500.0,
        _make_bench_orders(
            [(rpm, machine.set_points.opening_mm) for rpm in list_shaft_levels(machine) * 2]
        ),
    ),
    "openings": lambda job, machine: SeparatingDrive(
        _make_standing_job(job),
        500.0,
        _make_bench_orders(
            [(machine.set_points.shaft_rpm, mm) for mm in list_opening_levels(machine) * 2]
        ),
    ),
    "slope": lambda job, _machine: SeparatingDrive(
        _change_simulated(job, slope_deg=4.0, pass_length_m=140.0, passes=24, refill_at_kg=0.0),
        660.0,
        None,
    ),
    "two_speeds": _make_two_speed_drive,
    "out_of_work": _make_out_of_work_drive,
    "standing": lambda job, _machine: SeparatingDrive(
        _make_standing_job(job), 600.0, ((1.0, Order(Do.READY)),)
    ),
    "refill": _make_refill_drive,
}
