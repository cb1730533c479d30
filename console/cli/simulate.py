"""How does `topdress simulate` run the closed loop on the machine model, faster than real time?"""

from __future__ import annotations

import time
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer
from topdress.console.cli.inputs import JobName, MachineName, PlantedEffects
from topdress.console.cli.outputs import ForceOption, list_new_log_files, refuse_collisions
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.console.cli.progress import iterate_with_progress
from topdress.console.cli.terms import parse_terms, split_terms
from topdress.console.cli.whole_log import make_log_output, open_whole_log
from topdress.console.fast_imports import make_gc_rare
from topdress.control.orders import Strategy
from topdress.drivers import day_clock

# Type checking only: the simulation loads numpy and the machine model when the command runs.
if TYPE_CHECKING:
    from topdress.control.field.job import Job
    from topdress.control.machine.fault_injection import InjectedEffect
    from topdress.control.machine.machine import Machine
    from topdress.control.machine.steps import CompiledSteps
    from topdress.control.machine.terms import Term
    from topdress.control.simulation.closed_loop import RunRecord
    from topdress.control.simulation.dose_watch import DoseWatch
    from topdress.control.targets.point_mode import DoseThreshold
    from topdress.drivers.files.prescriptions.job_targets import LoopTargets
    from topdress.drivers.files.run_log import PlainLogWriter
    from topdress.drivers.files.run_meta import RunMeta
    from topdress.drivers.files.run_setup import Setup

# Control loop and simulator share a step of 0.05 s, i.e. 20 ticks a second as on the machine.
TICK_PERIOD_S = 0.05
# Length of a run from which compiling the steps saves time, s.
MIN_COMPILED_RUN_S = 600.0
# Number of doses from which the threshold is learned.
SETTLING_DOSES = 50
# The columns of LOG.truth.csv are a contract: readers find them by name.
TRUTH_COLUMNS = (
    "time_s",
    "shaft_rpm",
    "opening_mm",
    "flow_kg_s",
    "landed_rate_kg_ha",
    "landed_place_m",
    "place_m",
    "target_rate_kg_ha",
    "speed_mps",
    "east_m",
    "north_m",
    "working",
)


def run_simulation(
    *,
    machine: MachineName = "huanghai",
    job: JobName = "demo",
    seconds: Annotated[
        float, typer.Option(metavar="SECONDS", min=1.0, help="Simulated time.")
    ] = 600.0,
    seed: Annotated[int, typer.Option(metavar="NUMBER", min=0, help="Of canopy and noise.")] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG.csv",
            help="Run log; LOG.truth.csv is written next to it. Without it: nothing is written.",
        ),
    ] = None,
    effect: PlantedEffects = None,
    term: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TERM",
            help="Plant a term that the controller does not "
            'know (repeatable), e.g. "flow_percent bend speed_mps bend=-4.4 '
            'at=1.2"; see topdress effects.',
        ),
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Simulate another machine than the one that control "
            "knows: carried_along, singly, between (in the tube), pulsating, "
            "flow_3_more, flow_6_more, field_lag or slow_drives.",
        ),
    ] = None,
    strategy: Annotated[Strategy | None, typer.Option(help="Instead of the job's.")] = None,
    look_ahead: Annotated[
        str | None, typer.Option(metavar="on|off", help="Instead of the job's.")
    ] = None,
    flow_trim: Annotated[
        str | None,
        typer.Option(
            metavar="on|off", help="May the scale correct the flow model? Instead of the job's."
        ),
    ] = None,
    summary: Annotated[
        bool, typer.Option("--summary", help="Rate error, place error, kg, ha.")
    ] = False,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Run the control loop on the simulated machine and judge what came to lie on the ground."""
    from topdress.console.app.pages.job.map_words import describe_map_check
    from topdress.console.app.units import METRIC
    from topdress.control.machine.fault_injection import parse_planted
    from topdress.control.machine.parameter_uncertainty import make_plausible_machine
    from topdress.control.simulation.assembly import add_simulated_field
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.config_error import ConfigError
    from topdress.drivers.files.prescriptions.job_targets import find_map_check, read_loop_targets
    from topdress.drivers.files.run_setup import find_index_disagreements, load_setup

    # The files are loaded before the outputs are checked, because they count as inputs.
    setup = load_setup(machine, job, day_clock.read_today())
    given = {
        "strategy": strategy,
        "look_ahead": _parse_switch("--look-ahead", look_ahead),
        "flow_trim": _parse_switch("--flow-trim", flow_trim),
    }
    # None means that an option was not given, so the job's value stays.
    changes = {name: value for name, value in given.items() if value is not None}
    if out is not None:
        # Log and truth file are one output: neither is written if the other would overwrite a file.
        refuse_collisions(setup.files, [make_log_output(out, make_truth_path(out))], force)
        out.parent.mkdir(parents=True, exist_ok=True)
    # A job without a boundary gets the simulator's field, as in the console.
    resolved = add_simulated_field(setup.job.model_copy(update=changes), setup.machine)
    # A map of another index than the crop's rule would give wrong rates without any other sign.
    if lines := find_index_disagreements(None, setup.crop, resolved):
        raise ConfigError(lines)
    by_plugin, own = split_terms(effect or ())
    planted = [parse_planted(text) for text in own]
    # Control keeps the machine file, and only the simulated machine differs; the difference is the
    # test.
    true = setup.machine if plant is None else make_plausible_machine(setup.machine, plant)
    terms = parse_terms([*(term or ()), *by_plugin])
    plants_shown = [
        *([] if plant is None else [f"machine {plant}"]),
        *(effect or ()),
        *(term or ()),
    ]
    placed = read_loop_targets(resolved, setup.folder, setup.machine, setup.crop.index)
    check = find_map_check(resolved, setup.crop.max_rate_kg_ha, setup.folder)
    # Notes go to stderr, so that stdout holds the summary only.
    for line in (*resolved.warnings, *(() if check is None else describe_map_check(check, METRIC))):
        typer.echo(f"{job}: note: {line}", err=True)
    with (
        nullcontext()
        if out is None
        else open_whole_log(out, _make_run_meta(setup, resolved, seed)) as log
    ):
        run = _simulate_run(
            setup,
            true,
            resolved,
            seed=seed,
            planted=planted,
            terms=terms,
            seconds=seconds,
            placed=placed,
            log=log,
        )
        # The truth is written inside the block: a failed write then leaves no finished log without
        # its truth.
        if out is not None:
            write_atomically(
                make_truth_path(out),
                _format_truth(run.record, setup.machine.geometry.working_width_m),
            )
    if out is not None:
        written = ", ".join(str(path) for path in (*list_new_log_files(out), make_truth_path(out)))
        typer.echo(f"written: {written} ({seconds:g} s simulated)", err=as_json)
    if not (summary or as_json or out is None):
        return
    if run.doses is None:
        _print_summary(run, setup, resolved, seconds, plants_shown, as_json)
        return
    # Point mode runs a second time with the learned threshold reversed, so that its gain is shown.
    other = resolved.target.model_copy(
        update={"learn_threshold": not resolved.target.learn_threshold}
    )
    compared = _simulate_run(
        setup,
        true,
        resolved.model_copy(update={"target": other}),
        seed=seed,
        planted=planted,
        terms=terms,
        seconds=seconds,
        placed=placed,
        log=None,
    )
    learned, fixed = (run, compared) if resolved.target.learn_threshold else (compared, run)
    _print_dose_summary(run, learned, fixed, resolved, seconds, plants_shown, as_json)


class _SimulatedRun(NamedTuple):
    """Holds the result of one simulated run."""

    record: RunRecord
    # Readings of the heads, each sample once, while material flowed.
    heads: list[tuple[float, ...]]
    # Number of ticks with each alarm.
    alarms: dict[str, int]
    # Doses of point mode; None in other modes.
    doses: DoseWatch | None
    # Trigger threshold of point mode, as learned; None in other modes.
    threshold: DoseThreshold | None
    took_s: float


def _simulate_run(
    setup: Setup,
    true: Machine,
    job: Job,
    *,
    seed: int,
    planted: list[InjectedEffect],
    terms: list[Term],
    seconds: float,
    placed: LoopTargets,
    log: PlainLogWriter | None,
) -> _SimulatedRun:
    from topdress.control.orders import TargetSource
    from topdress.control.simulation.assembly import make_control_loop, make_plant
    from topdress.control.simulation.closed_loop import RunRecord, simulate_run
    from topdress.control.simulation.dose_watch import DoseWatch
    from topdress.drivers.files.optional_packages import is_extra_installed

    compiled: CompiledSteps | None = None
    # Compiling takes seconds, which only a long run saves; it needs numba of the extra "diagnosis".
    if seconds >= MIN_COMPILED_RUN_S and is_extra_installed("diagnosis"):
        from topdress.control.simulation.compiled_steps import COMPILED_STEPS

        compiled = COMPILED_STEPS
    plant = make_plant(
        true,
        job,
        seed,
        TICK_PERIOD_S,
        planted,
        plants=placed["plants"],
        terms=terms,
        steps=compiled,
    )
    loop = make_control_loop(setup.machine, setup.crop, setup.rule, job, **placed, steps=compiled)
    doses = None
    if job.target.source is TargetSource.POINT:
        # The watch has a random stream of its own, so that it does not change the noise of the
        # machine.
        doses = DoseWatch(plant.plants_m, seed + 3, job.simulated.dose_measured_sd_m)
    record = RunRecord()
    alarms: dict[str, int] = {}
    heads: list[tuple[float, ...]] = []
    # Fewer garbage collections save a tenth of the time of a simulated run.
    make_gc_rare()
    # perf_counter is monotonic: a change of the clock cannot distort the speed.
    started = time.perf_counter()
    steps = simulate_run(plant, loop, seconds, doses=doses)
    for step in iterate_with_progress(steps, round(seconds / TICK_PERIOD_S), "simulating"):
        record.add_tick(step)
        ndvi = step.tick.head_ndvi
        if (
            step.tick.row.applied_rate_kg_ha
            and ndvi
            and None not in ndvi
            # A head's sample stays in the row until the next sample, so equal rows count once.
            and (not heads or heads[-1] != ndvi)
        ):
            heads.append(tuple(value for value in ndvi if value is not None))
        for name in (step.tick.row.alarms or "").split(";"):
            if name:
                alarms[name] = alarms.get(name, 0) + 1
        if log is not None:
            log.append(step.tick.row)
    return _SimulatedRun(
        record, heads, alarms, doses, loop.threshold, time.perf_counter() - started
    )


def _parse_switch(option: str, text: str | None) -> bool | None:
    if text not in ("on", "off", None):
        raise CommandError(f"{option} {text}: allowed on or off")
    return None if text is None else text == "on"


def _make_run_meta(setup: Setup, job: Job, seed: int) -> RunMeta:
    from topdress.drivers.files.run_meta import make_run_meta

    return make_run_meta(
        setup.machine,
        setup.crop,
        job,
        seed=seed,
        sha256=setup.sha256,
        extra={"job_folder": str(setup.folder)},
    )


def make_truth_path(log: Path) -> Path:
    """Returns the path of the log's truth file."""
    return log.with_name(f"{log.stem}.truth.csv")


def _format_truth(record: RunRecord, width_m: float) -> str:
    import io

    import numpy as np
    from topdress.control.simulation.error_metrics import find_true_landing

    columns = record.make_columns()
    landed_kg_ha, landed_m = find_true_landing(columns, width_m)
    table = np.column_stack(
        [
            # The record counts at the end of a step, the log at its beginning.
            columns["time_s"] - TICK_PERIOD_S,
            columns["shaft_rpm"],
            columns["opening_mm"],
            columns["flow_kg_s"],
            landed_kg_ha,
            landed_m,
            columns["driven_m"],
            columns["target_kg_ha"],
            columns["speed_mps"],
            columns["east_m"],
            columns["north_m"],
            columns["working"],
        ]
    )
    text = io.StringIO()
    np.savetxt(
        text,
        table,
        delimiter=",",
        header=",".join(TRUTH_COLUMNS),
        comments="",
        # The decimals match the resolution of the model: 0.1 ms, 0.1 mm, and 0.1 mg/s of flow.
        fmt=[
            "%.3f",
            "%.4f",
            "%.4f",
            "%.7f",
            "%.3f",
            "%.4f",
            "%.4f",
            "%.3f",
            "%.5f",
            "%.4f",
            "%.4f",
            "%d",
        ],
    )
    return text.getvalue()


def _print_summary(
    run: _SimulatedRun, setup: Setup, job: Job, seconds: float, effects: list[str], as_json: bool
) -> None:
    from topdress.control.field.width_error import describe_width_error, measure_width_error
    from topdress.control.orders import TargetSource
    from topdress.control.simulation.error_metrics import judge_run

    record, alarms, took_s = run.record, run.alarms, run.took_s
    # Errors against the need of the canopy exist only where the canopy alone sets the rate.
    by_canopy = (
        job.target.source is TargetSource.CANOPY
        and job.target.hold_mean_kg_ha is None
        and job.target.zone_map is None
    )
    found = judge_run(
        record.make_columns(),
        record.fired,
        setup.machine.geometry.working_width_m,
        rule=setup.rule if by_canopy else None,
    )
    # An interval over one sample of the heads does not exist.
    one_rate = (
        measure_width_error(setup.rule, setup.machine, run.heads)
        if by_canopy and len(run.heads) > 1
        else None
    )
    if as_json:
        print_json(
            {
                "seconds": seconds,
                "strategy": job.strategy.in_force,
                "look_ahead": job.look_ahead,
                "flow_trim": job.flow_trim,
                "effects": effects,
                **found._asdict(),
                "one_rate": one_rate,
                "alarm_ticks": alarms,
                "realtime_factor": round(seconds / took_s, 1),
            }
        )
        return
    typer.echo(
        f"{seconds:g} s, {job.strategy.in_force.value}, look-ahead "
        f"{'on' if job.look_ahead else 'off'}, "
        f"flow trim {'on' if job.flow_trim else 'off'}"
        + (f", planted {', '.join(effects)}" if effects else "")
    )
    typer.echo(
        f"rate error   {found.rate_error_kg_ha:.1f} kg/ha against what was held "
        f"({found.rate_error_percent:.2f} % of the mean target {found.mean_target_kg_ha:.1f}), "
        f"landed mean {found.mean_landed_kg_ha:.1f} kg/ha"
    )
    for name, miss, percent in (
        ("graded", found.graded_error_kg_ha, found.graded_error_percent),
        ("smooth", found.smooth_error_kg_ha, found.smooth_error_percent),
    ):
        if miss is not None and percent is not None:
            typer.echo(
                f"             against the {name} need of the canopy {miss:.1f} kg/ha "
                f"({percent:.2f} % of the "
                f"mean need)"
            )
    if one_rate is not None:
        typer.echo(f"one rate     {describe_width_error(one_rate)}")
    typer.echo(
        f"place error  mean {found.place_error_m:.3f} m, bias {found.place_bias_m:+.3f} m "
        "(late is positive), "
        f"p50 {found.place_p50_m:.3f} m, p95 {found.place_p95_m:.3f} m, {found.steps} steps, "
        f"{found.steps_lost} lost"
    )
    typer.echo(f"mass         {found.released_kg:.2f} kg released, {found.landed_kg:.2f} kg landed")
    typer.echo(f"area         {found.area_ha:.4f} ha")
    typer.echo(
        f"alarms       {', '.join(f'{k} {n} ticks' for k, n in sorted(alarms.items())) or 'none'}"
    )
    typer.echo(f"speed        {seconds / took_s:.0f} simulated seconds a second ({took_s:.1f} s)")


def _print_dose_summary(
    run: _SimulatedRun,
    learned: _SimulatedRun,
    fixed: _SimulatedRun,
    job: Job,
    seconds: float,
    effects: list[str],
    as_json: bool,
) -> None:
    """Prints dose errors with and without the learned threshold; `run` is the run of the job."""
    assert learned.doses is not None and fixed.doses is not None
    # The first doses serve to learn the threshold and would blur its result.
    with_it, without = (
        learned.doses.judge_doses(SETTLING_DOSES),
        fixed.doses.judge_doses(SETTLING_DOSES),
    )
    if as_json:
        print_json(
            {
                "seconds": seconds,
                "effects": effects,
                "learn_threshold": job.target.learn_threshold,
                "with_threshold": with_it,
                "without_threshold": without,
                "alarm_ticks": run.alarms,
                "realtime_factor": round(seconds / run.took_s, 1),
            }
        )
        return
    typer.echo(
        f"{seconds:g} s, point mode, doses of {job.target.dose_angle_deg:g} degrees"
        + (f", planted {', '.join(effects)}" if effects else "")
    )
    for name, e in (("learned threshold", with_it), ("without threshold", without)):
        typer.echo(
            f"{name}  dose error p50 {e.p50_m:.3f} m, p95 {e.p95_m:.3f} m, mean "
            f"{e.mean_m:+.3f} m (late is "
            f"positive); {e.doses} doses of {e.dose_g:.2f} g, {e.plants} plants, {e.missed} "
            "missed, "
            f"{e.doubled} doubled"
        )
    assert learned.threshold is not None
    typer.echo(
        f"threshold    {learned.threshold.offset_m:+.3f} m {learned.threshold.delay_s:+.3f} "
        "s x speed; errors "
        f"after the first {SETTLING_DOSES} doses"
    )
    typer.echo(
        "alarms       "
        f"{', '.join(f'{k} {n} ticks' for k, n in sorted(run.alarms.items())) or 'none'}"
    )
    typer.echo(
        f"speed        {seconds / run.took_s:.0f} simulated seconds a second ({run.took_s:.1f} s)"
    )
