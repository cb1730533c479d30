"""Which rates of a job can a machine not apply at the job's speeds? `topdress check`
reports them.
"""

from __future__ import annotations

from pathlib import Path

from topdress.control.field.job import Job
from topdress.control.metering.rate_range import find_rate_range, find_speed_range
from topdress.control.orders import CANOPY_SOURCES, MAP_SOURCES, TargetSource
from topdress.drivers.files.prescriptions.job_targets import find_map_rates
from topdress.drivers.files.run_setup import Setup

MPS_PER_KMH = 1.0 / 3.6


def find_range_notes(setup: Setup) -> list[str]:
    """Returns one line for each rate of the job that is beyond the machine's range at a speed of
    the job.

    Raises PrescriptionError, OSError where the job's map cannot be read.
    """
    if setup.job.target.source is TargetSource.POINT:
        return []
    machine, width_m = setup.machine, setup.machine.geometry.working_width_m
    notes = []
    for kmh in _list_speeds_kmh(setup.job):
        low, high = find_rate_range(machine, kmh * MPS_PER_KMH, width_m)
        for what, rate_kg_ha in _find_extreme_rates(setup):
            if low <= rate_kg_ha <= high:
                continue
            slowest, fastest = find_speed_range(machine, rate_kg_ha, width_m)
            limit = (
                f"at least {low:.0f} kg/ha at {kmh:g} km/h; {slowest / MPS_PER_KMH:.1f} km/h or "
                "faster would do"
                if rate_kg_ha < low
                else f"at most {high:.0f} kg/ha at {kmh:g} km/h; {fastest / MPS_PER_KMH:.1f} km/h "
                "or slower would do"
            )
            notes.append(f"{what} {rate_kg_ha:g} kg/ha: machine {machine.id} gives {limit}")
    return notes


def _list_speeds_kmh(job: Job) -> list[float]:
    """Returns the planned speeds of the passes, km/h; the simulated speed if none is planned."""
    planned = job.planned_speed_kmh
    if planned is None:
        return [job.simulated.speed_kmh]
    return [planned] if isinstance(planned, int | float) else sorted({min(planned), max(planned)})


def _find_extreme_rates(setup: Setup) -> list[tuple[str, float]]:
    """Returns the lowest and the highest rate above 0 of each source of the job, with its name."""
    job, crop = setup.job, setup.crop
    target = job.target
    rates: list[tuple[str, float | None]] = [("headland rate", job.field.headland_rate_kg_ha)]
    if target.source is TargetSource.MANUAL:
        rates.append(("manual rate", target.manual_rate_kg_ha))
    if target.source is TargetSource.EXTERNAL:
        rates.append(("rate without the other display", target.external_silent_kg_ha))
    if target.source in CANOPY_SOURCES:
        rates += [
            ("mean rate", target.hold_mean_kg_ha),
            ("the crop's lowest rate", crop.min_rate_kg_ha),
            ("the crop's fallback rate", crop.fallback_rate_kg_ha),
        ]
    if target.source in MAP_SOURCES and (of_map := find_map_rates(job, Path(setup.folder))):
        rates += [("the map's lowest rate", of_map[0]), ("the map's highest rate", of_map[-1])]
    return [
        (what, min(rate, crop.max_rate_kg_ha)) for what, rate in rates if rate is not None and rate
    ]
