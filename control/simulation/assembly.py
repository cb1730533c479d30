"""Machine, crop and job to a control loop and, where the machine is simulated, its plant."""
from __future__ import annotations

from collections.abc import Callable, Sequence

from control.agronomy.crop import Crop
from control.agronomy.noa import Rule
from control.field.boundary import Boundary
from control.field.job import Job
from control.loop import ControlLoop
from control.machine.machine import Machine
from control.machine.planting import Planted
from control.targets.fence import Fence
from control.targets.map_profile import MapProfile

from .plant import Plant, Truth
from .tractor import field_boundary


def with_simulated_field(job: Job, machine: Machine) -> Job:
    """A job that names no boundary gets the rectangle of its simulated passes."""
    if job.field.boundary_m:
        return job
    corners = field_boundary(job.simulated, machine.geometry.working_width_m, job.field.pass_heading_deg)
    return job.model_copy(update={"field": job.field.model_copy(update={"boundary_m": corners})})


def control_loop(machine: Machine, crop: Crop, rule: Rule, job: Job, has_work_switch: bool = False,
                 prescription: MapProfile | None = None) -> ControlLoop:
    """The loop of a job; fenced where the job knows its field. `prescription`: on the job's plane, for map mode."""
    fence = Fence(Boundary(job.field.boundary_m)) if job.field.boundary_m else None
    return ControlLoop(machine, crop, rule, job, fence, has_work_switch, prescription=prescription)


def simulated_machine(machine: Machine, job: Job, seed: int, dt_s: float, planted: Sequence[Planted] = (),
                      keep: Callable[[Truth], None] | None = None) -> Plant:
    """The plant of a job. Raises ValueError where an effect does not fit the machine."""
    return Plant(machine, job, seed, dt_s, planted, keep=keep)
