"""How are machine, crop and job assembled to a control loop and a simulated plant?"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.field.boundary import Boundary
from topdress.control.field.done_ground import DoneGround
from topdress.control.field.job import Job
from topdress.control.loop import ControlLoop
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.fault_injection import InjectedEffect
from topdress.control.machine.machine import Machine
from topdress.control.machine.steps import CompiledSteps
from topdress.control.machine.terms import Term
from topdress.control.orders import TargetSource
from topdress.control.readings import DoseOrder
from topdress.control.targets.boundary_profile import BoundaryAhead
from topdress.control.targets.index_map import IndexMap
from topdress.control.targets.map_profile import MapProfile
from topdress.control.targets.plant_doser import DoseError, PlantDoser
from topdress.control.targets.plant_places import PlantList
from topdress.control.targets.point_mode import PointLag

from .plant import Plant, PlantTruth
from .tractor import make_field_boundary


def add_simulated_field(job: Job, machine: Machine) -> Job:
    """Returns the job with the rectangle of its simulated passes where it has no boundary."""
    # A field of the job is never replaced.
    if job.field.boundary_m:
        return job
    corners = make_field_boundary(
        job.simulated, machine.geometry.working_width_m, job.field.pass_heading_deg
    )
    return job.model_copy(update={"field": job.field.model_copy(update={"boundary_m": corners})})


def make_control_loop(
    machine: Machine,
    crop: Crop,
    rule: CropRule,
    job: Job,
    has_work_switch: bool = False,
    *,
    prescription: MapProfile | None = None,
    plants: PlantList | None = None,
    dose_errors: Sequence[DoseError] = (),
    obeyed: bool = True,
    index_map: IndexMap | None = None,
    zone_map: IndexMap | None = None,
    done: DoneGround | None = None,
    steps: CompiledSteps | None = None,
    record_only: bool = False,
) -> ControlLoop:
    """Returns the loop of a job, bounded where the job has a field.

    Parameters
    ----------
    machine, crop, rule, job : as their files say.
    has_work_switch : a work switch is fitted.
    prescription, plants : on the job's plane, for map and point mode.
    dose_errors : errors from which the threshold begins.
    obeyed, index_map, zone_map, done, steps, record_only : as for `ControlLoop`.

    Raises
    ------
    ValueError : headland or margins leave nothing of the field."""
    # Without valves the whole machine is one strip.
    strips = [strip.right_m - strip.left_m for strip in machine.switched_strips] or [
        machine.geometry.working_width_m
    ]
    # The middle of a strip keeps half of its width from every margin.
    boundary = job.field.make_spread_ground(0.5 * max(strips))
    fence = BoundaryAhead(boundary) if boundary is not None else None
    headland = (
        BoundaryAhead(_subtract_headland(job))
        # A headland needs a field from whose edge it is measured.
        if fence is not None and job.field.headland_m > 0.0
        else None
    )
    points = None
    # Plants may be given for a job whose source is changed to point later.
    if plants is not None or job.target.source is TargetSource.POINT:
        points = make_point_source(machine, job, plants, dose_errors)
    return ControlLoop(
        machine,
        crop,
        rule,
        job,
        fence,
        has_work_switch,
        prescription=prescription,
        points=points,
        headland=headland,
        obeyed=obeyed,
        index_map=index_map,
        zone_map=zone_map,
        done=done,
        steps=steps,
        record_only=record_only,
    )


def _subtract_headland(job: Job) -> Boundary:
    """Returns the field without its headland. Raises ValueError where nothing is left."""
    inner = Boundary(job.field.boundary_m, job.field.holes_m).inset_margin(job.field.headland_m)
    # A headland wider than half the field leaves nothing to work on.
    if inner.is_empty:
        raise ValueError(
            f"job {job.id}: field.headland_m {job.field.headland_m:g}: leaves nothing of the field"
        )
    return inner


def make_point_source(
    machine: Machine, job: Job, plants: PlantList | None, dose_errors: Sequence[DoseError] = ()
) -> PlantDoser:
    """Returns the point mode of a job. Its lag follows the machine file: the time between
    command and shaft is the link (point paper, eq 2), the fall is the drop time; a camera's
    computing time is known from its pictures."""
    dose = DoseOrder(job.target.dose_angle_deg, machine.set_points.shaft_rpm)
    shaft = machine.shaft
    lag = PointLag(
        # A camera's pictures have a time, so its delay is part of the plant's position.
        0.0,
        shaft.dead_time_s + shaft.extra_dead_time_s,
        dose.angle_deg / (6.0 * dose.shaft_rpm),
        calc_drop_s(machine.fall, dose.shaft_rpm),
    )
    return PlantDoser(
        lag,
        dose,
        0.5 * machine.geometry.working_width_m,
        plants,
        job.target.learn_threshold,
        job.target.dose_rest_s,
        dose_errors,
    )


def make_plant(
    machine: Machine,
    job: Job,
    seed: int,
    dt_s: float,
    planted: Sequence[InjectedEffect] = (),
    *,
    keep: Callable[[PlantTruth], None] | None = None,
    plants: PlantList | None = None,
    terms: Sequence[Term] = (),
    steps: CompiledSteps | None = None,
) -> Plant:
    """Returns the plant of a job.

    Parameters
    ----------
    planted : effects that the controller does not know.
    keep : called with the truth of each step.
    plants : of the job's plant list.
    terms : added to those of the machine's file.
    steps : as for `Plant`.

    Raises
    ------
    ValueError : an effect does not fit the machine."""
    return Plant(
        machine,
        job,
        seed,
        dt_s,
        planted,
        keep=keep,
        plants=None if plants is None else plants.places_m,
        terms=terms,
        steps=steps,
    )
