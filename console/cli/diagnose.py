"""How does `topdress diagnose` show the errors of the machine model on measured data, their causes,
and the gain of a correction?
"""

from __future__ import annotations

import dataclasses
import json
import shlex
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from topdress.console.cli.inputs import (
    LOG_KINDS,
    MachineName,
    load_machine,
    refuse_other_kinds,
    require_suffix,
)
from topdress.console.cli.outputs import (
    ForceOption,
    Output,
    find_machine_file,
    list_log_files,
    make_marked_output,
    refuse_collisions,
)
from topdress.console.cli.plain_errors import EXIT_NOT_JUDGED, CommandError, print_note_lines
from topdress.console.cli.progress import ProgressLine
from topdress.console.fast_imports import make_gc_rare
from topdress.drivers import day_clock

# Type checking only: the diagnosis loads numpy and scipy, which other commands do not need.
if TYPE_CHECKING:
    from topdress.control.diagnosis.result import Cause, Diagnosis
    from topdress.control.diagnosis.runs.several import JointDiagnosis
    from topdress.control.machine.machine import Machine
    from topdress.drivers.files.run_setup import Setup


# `diagnose --adopt` writes everything that is decided, and of the undecided causes only those
# selected by name.
def refuse_picked_causes(picked: tuple[str, ...], out: Path | None) -> None:
    """Raises CommandError, before minutes of work, for names that no diagnosis could give."""
    from topdress.control.machine.machine import CATALOGUE

    for name in picked:
        # A pick without --adopt would be ignored in silence.
        if out is None:
            raise CommandError(f"--pick {name}: only --adopt takes up a cause")
        if name not in CATALOGUE:
            raise CommandError(
                f"--pick {name}: allowed are the names that `topdress effects` lists"
            )


def try_adoption(
    found: Diagnosis, machine: Machine, data: list[Path], out: Path, picked: tuple[str, ...] = ()
) -> tuple[Diagnosis, Exception | None]:
    """Returns the diagnosis with the machine file that was written; without a file also the
    exception with which the command ends."""
    try:
        return adopt_findings(found, machine, data, out, picked), None
    # The exception is returned and raised later, so that minutes of diagnosis still reach the
    # screen and the files.
    except (ValueError, OSError, CommandError, typer.Exit) as why:
        return found, why


def adopt_findings(
    found: Diagnosis, machine: Machine, data: list[Path], out: Path, picked: tuple[str, ...] = ()
) -> Diagnosis:
    """Writes the machine file, and prints on stderr the adopted and the refused findings, the
    reasons, and how to undo the change.

    Raises ValueError for a finding that applies to a part of the data only, CommandError for a name
    that cannot be selected, typer.Exit if nothing remains to adopt.
    """
    from topdress.console.reports.diagnosis_wording import describe_whole, describe_whole_gain
    from topdress.console.reports.term_words import compare_side_by_side
    from topdress.control.diagnosis.extend import check_adoptable, extend
    from topdress.control.diagnosis.runs.adoption import select_adoptable
    from topdress.drivers.files.config import calc_sha256, save_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    # All causes are checked before anything is printed or written.
    for cause in found.causes:
        check_adoptable(cause)
    for name in picked:
        _refuse_pick(name, found, out)
    # A selection by name excludes the unnamed correction with the best prediction.
    if picked:
        found = dataclasses.replace(
            found, fitted=None, terms=tuple(one for one in found.terms if not one.predicts_best)
        )
    chosen = [cause.id for cause in found.causes if _is_adopted(cause, picked, found)]
    # The selection is judged on held-out rows: a correction that predicts worse is refused.
    taken = select_adoptable(found, chosen)
    for name, why in taken.refused:
        typer.echo(f"note: {name} is not adopted: {why}", err=True)
    kept = taken.found.causes
    if taken.found.fitted is not None:
        print_note_lines(
            [describe_whole(taken.found.fitted), describe_whole_gain(taken.found.fitted)]
        )
    _print_term_notes(found)
    if not kept and not taken.found.terms and taken.found.fitted is None:
        raise _make_empty_exit(found, out, bool(taken.refused))
    extended = extend(
        # The history stores one checksum; for several logs it is that of the first.
        machine,
        taken.found,
        sha256=calc_sha256(data[0]),
        date=day_clock.read_today().isoformat(),
    )
    save_config(out, extended, MACHINE_KIND, _format_pick_comment(kept, picked))
    typer.echo(
        # The path is quoted, so that the printed command can be pasted into a shell.
        f"{out}, before -> after (topdress history {shlex.quote(str(out))} --undo --out FILE takes "
        "it back):",
        err=True,
    )
    typer.echo("\n".join(compare_side_by_side(extended.history[-1])), err=True)
    return dataclasses.replace(found, extended_machine=str(out))


def _is_adopted(cause: Cause, picked: tuple[str, ...], found: Diagnosis) -> bool:
    """Returns whether a cause is written into the file; prints the reason if not, and that it was
    selected."""
    from topdress.console.reports.diagnosis_wording import is_undecided
    from topdress.control.diagnosis.extend import find_cause_refusal, is_in_drive_fit

    if is_in_drive_fit(found, cause):
        # The fit of the whole drive reports this effect.
        return False
    if why := find_cause_refusal(cause):
        typer.echo(f"note: {cause.id} is not adopted: {why}", err=True)
        return False
    if not is_undecided(cause):
        return True
    if cause.id in picked:
        typer.echo(
            f"note: {cause.id} is adopted as picked, though {_describe_doubt(cause)}", err=True
        )
        return True
    typer.echo(
        f"note: {cause.id} is not adopted: {_describe_doubt(cause)}; --pick {cause.id} adopts "
        f"it all "
        "the same",
        err=True,
    )
    return False


def _describe_doubt(cause: Cause) -> str:
    from topdress.console.reports.diagnosis_wording import find_effect_name, list_rivals

    rivals = ", ".join(find_effect_name(one) for one, _share in list_rivals(cause))
    return f"this data cannot tell it from {rivals}" if rivals else "it is only suspected"


def _refuse_pick(name: str, found: Diagnosis, out: Path) -> None:
    """Raises CommandError with the reason."""
    from topdress.console.reports.diagnosis_wording import is_undecided
    from topdress.control.diagnosis.extend import find_cause_refusal

    own = [cause for cause in found.causes if cause.id == name]
    if any(not find_cause_refusal(cause) for cause in own):
        # A name that occurs several times is accepted if one occurrence can be adopted.
        return
    offered = ", ".join(
        dict.fromkeys(
            one.id for one in found.causes if is_undecided(one) and not find_cause_refusal(one)
        )
    )
    why = f"not found in this data; undecided: {offered or 'nothing'}"
    if own:
        why = find_cause_refusal(own[0])
    # A rival has no size of its own yet, hence a machine file cannot contain it.
    elif any(rival.id == name for cause in found.causes for rival in cause.rivals):
        why = "its size is not known before the run that tells it from its rivals (next run)"
    raise CommandError(f"{out}: not written: --pick {name}: {why}")


def _print_term_notes(found: Diagnosis) -> None:
    from topdress.console.reports.term_words import describe_compensation
    from topdress.control.diagnosis.extend import find_term_refusal

    for one in found.terms:
        why = find_term_refusal(one)
        word = f"is not adopted: {why}" if why else f"is adopted. {describe_compensation(one.term)}"
        typer.echo(f"note: term {one.term['id']} {word}", err=True)


def _make_empty_exit(found: Diagnosis, out: Path, refused: bool) -> typer.Exit:
    from topdress.control.diagnosis.extend import list_adoptable_causes

    why = "no effect and no term was found that a machine file could take up"
    if refused:
        why = "a machine file with what was found would predict no better"
    elif list_adoptable_causes(found):
        why = "what was found is undecided, and nothing of it was picked"
    # The reason goes to stderr, and stdout keeps the diagnosis.
    typer.echo(f"{out}: not written: {why}", err=True)
    return typer.Exit(EXIT_NOT_JUDGED)


def _format_pick_comment(kept: tuple[Cause, ...], picked: tuple[str, ...]) -> str:
    """Returns the file's comment on causes that were selected although the data do not decide."""
    from topdress.console.reports.diagnosis_wording import is_undecided

    return "\n".join(
        f"{cause.id}: picked by name (diagnose --pick), though {_describe_doubt(cause)}."
        for cause in kept
        if is_undecided(cause) and cause.id in picked
    )


# Number of groups of channels that are judged in parallel.
PARALLEL_GROUPS = 2


def run_diagnose(
    data: Annotated[
        list[Path],
        typer.Argument(
            metavar="DATA.csv...",
            help="One or more run logs, or one or more bench tables, of the same machine.",
        ),
    ],
    *,
    machine: MachineName = "huanghai",
    kind: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="run, lag, catch, weigh, heads or place; default: from the columns.",
        ),
    ] = None,
    as_json: Annotated[
        Path | None,
        typer.Option("--json", metavar="OUT", help="The result as JSON; - for standard output."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="OUT.html", help="A page with pictures.")
    ] = None,
    adopt: Annotated[
        Path | None,
        typer.Option(
            metavar="NEW.yaml",
            help="A machine file with the findings; what is undecided is left out.",
        ),
    ] = None,
    pick: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Of --adopt: an undecided cause, by its name, "
            "to be adopted all the same (repeatable).",
        ),
    ] = None,
    closed_loop: Annotated[
        float | None,
        typer.Option(
            min=60.0,
            metavar="SECONDS",
            help="Also simulate a job this "
            "long, twice, on a machine that has the named effects: "
            "control without and with knowing them.",
        ),
    ] = None,
    job: Annotated[
        str | None,
        typer.Option(
            metavar="JOB",
            help="Of --closed-loop: job file, or name of a shipped one; default demo.",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(metavar="NUMBER", min=0, help="Of the draws behind the probabilities.")
    ] = 0,
    force: ForceOption = False,
) -> None:
    """Find what is wrong with the machine: the cause, its size, how sure it is, what it costs
    and what to do.

    Exit code 3: nothing of the data could be judged, or --adopt found nothing that is decided.
    """
    # Fewer garbage collections save time of the imports and of the fit.
    make_gc_rare()
    # Every refusal comes before the diagnosis, which takes minutes.
    refuse_other_kinds(data, LOG_KINDS)
    require_suffix("--report", report, ".html")
    require_suffix("--adopt", adopt, ".yaml", ".yml")
    if job is not None and closed_loop is None:
        raise CommandError(f"--job {job}: only --closed-loop simulates a job")
    picked = tuple(pick or ())
    refuse_picked_causes(picked, adopt)
    loaded = load_machine(machine)
    setup = None if closed_loop is None else _load_job_setup(machine, job or "demo")
    # Files that are read must not be overwritten, even with --force.
    reads = [*(file for path in data for file in list_log_files(path)), find_machine_file(machine)]
    refuse_collisions(
        [*reads, *(() if setup is None else setup.files)],
        _list_outputs(as_json, report, adopt),
        force,
    )
    several: JointDiagnosis | None = None
    if kind == "run" or (kind is None and _is_run_data(data)):
        if len(data) > 1:
            several, tools = _diagnose_several_logs(data, loaded)
            found = several.together
        else:
            found, tools = _diagnose_run_log(data[0], loaded, seed)
    else:
        found, tools = _diagnose_bench_tables(data, loaded, kind, seed)
    refused: Exception | None = None
    # Logs of several machines of a kind share an effect and not its size, so there is no single
    # machine file.
    if several is not None and several.of_a_kind and adopt is not None:
        refused = CommandError(
            f"--adopt {adopt}: these logs are of machines of a kind, each with sizes of its own: "
            "allowed is one log, or logs of one machine"
        )
    elif adopt is not None:
        found, refused = try_adoption(found, loaded, data, adopt, picked)
    # The result is written even if the adoption failed.
    _write_result(found, several, as_json, report, tools)
    if setup is not None and closed_loop is not None:
        for line in _simulate_findings(found, setup, job or "demo", closed_loop):
            typer.echo(line, err=as_json is not None and str(as_json) == "-")
    if refused is not None:
        raise refused
    if found.verdict == "not_judged" and not found.rates:
        # A separate exit code lets a script tell "nothing judged" from an error.
        raise typer.Exit(EXIT_NOT_JUDGED)


def _list_outputs(as_json: Path | None, report: Path | None, adopt: Path | None) -> list[Output]:
    from topdress.console.reports.html import GENERATOR_META

    outputs = []
    # "-" is the standard output and no file.
    if as_json is not None and str(as_json) != "-":
        outputs.append(make_marked_output(as_json, b'"format": "topdress-diagnosis/1"'))
    if report is not None:
        outputs.append(make_marked_output(report, GENERATOR_META.encode()))
    if adopt is not None:
        outputs.append(Output((adopt,)))
    return outputs


def _is_run_data(data: list[Path]) -> bool:
    """Returns whether the data are a run log of any program, by the import where its columns have
    no names; otherwise they are a bench table."""
    from topdress.drivers.files.file_content import FileContent

    # The first file decides: several files must be of one kind, which the reader checks.
    file = FileContent(data[0])
    return not file.is_table or not file.names or file.content_kind == "log"


def _read_log_columns(path: Path, machine: Machine) -> tuple[dict[str, Any], list[str]]:
    """Returns a log's columns that a diagnosis reads, and notes on odd data."""
    from topdress.control.diagnosis.runs.log import UNREAD_COLUMNS
    from topdress.control.log_row import TEXT_COLUMNS
    from topdress.drivers.files.any_log import open_any_log

    # Numbers are examined, and their oddities are reported.
    log = open_any_log(path, UNREAD_COLUMNS & TEXT_COLUMNS)
    odd = [
        str(finding)
        for finding in log.findings
        # A column of a stage that the machine does not have is not missing.
        if finding.id != "missing" or not machine.stages
    ]
    return {name: array for name, array in log.columns.items() if name not in UNREAD_COLUMNS}, odd


def _diagnose_run_log(data: Path, machine: Machine, seed: int) -> tuple[Diagnosis, dict[str, Any]]:
    from topdress.control.diagnosis.runs.diagnose import diagnose_run

    columns, odd = _read_log_columns(data, machine)
    said: tuple[str, ...] = ()
    try:
        with ThreadPoolExecutor(PARALLEL_GROUPS) as pool:
            found = diagnose_run(
                columns,
                machine,
                path=str(data),
                progress=_make_progress(),
                seed=seed,
                each=pool.map,
            )
        said = found.findings
    # Notes that the report contains are printed only once.
    finally:
        print_note_lines(one for one in odd if one not in said)
    return found, {"columns": columns, "machine": machine}


def _diagnose_several_logs(
    data: list[Path], machine: Machine
) -> tuple[JointDiagnosis, dict[str, Any]]:
    """Returns the diagnosis of logs of one machine: effects that they share, and each log's own."""
    from topdress.control.diagnosis.runs.several import diagnose_runs, join_logs

    twice = next(
        (
            path
            for k, path in enumerate(data)
            if path.resolve() in [one.resolve() for one in data[:k]]
        ),
        None,
    )
    # Rows that count twice would halve the variance, and intervals would be too narrow.
    if twice is not None:
        raise CommandError(
            f"{twice}: named twice: allowed is each log once, for its rows would count twice"
        )
    other = next((path for path in data if not _is_run_data([path])), None)
    if other is not None:
        raise CommandError(
            f"{other}: a bench table among run logs: allowed are logs together, or tables together"
        )
    logs, names = [], [str(path) for path in data]
    for path in data:
        columns, odd = _read_log_columns(path, machine)
        print_note_lines(odd, f"{path}: ")
        logs.append(columns)
    with ThreadPoolExecutor(PARALLEL_GROUPS) as pool:
        found = diagnose_runs(logs, machine, paths=names, progress=_make_progress(), each=pool.map)
    return found, {"columns": join_logs(logs, names, machine), "machine": machine}


def _diagnose_bench_tables(
    data: list[Path], machine: Machine, kind: str | None, seed: int
) -> tuple[Diagnosis, dict[str, Any]]:
    from topdress.control.diagnosis.tables.diagnose import diagnose_tables
    from topdress.drivers.files.bench_table import read_bench_table

    tables = [read_bench_table(path, kind) for path in data]
    return diagnose_tables(tables, machine, seed=seed, progress=_make_progress()), {
        "tables": tables,
        "machine": machine,
    }


def _make_progress() -> Any:
    line = ProgressLine()

    def show_share(share: float, word: str) -> None:
        if share >= 1.0:
            line.clear_line()
        else:
            line.show_text(f"{100 * share:3.0f} % {word} (Ctrl-C cancels)")

    # No progress is drawn into a file or a pipe.
    return show_share if line.shown else None


def _load_job_setup(machine: str, job: str) -> Setup:
    from topdress.control.orders import TargetSource
    from topdress.drivers.files.run_setup import load_setup

    setup = load_setup(machine, job, day_clock.read_today())
    # Other targets need a map or plants, which this comparison does not load.
    if setup.job.target.source not in (TargetSource.CANOPY, TargetSource.MANUAL):
        raise CommandError(
            f"--job {job}: target {setup.job.target.source.value}: --closed-loop simulates jobs of "
            "target canopy or manual"
        )
    return setup


def _simulate_findings(found: Diagnosis, setup: Setup, job: str, seconds: float) -> list[str]:
    """Simulates control with and without knowledge of the effects. The sizes found are used as the
    true sizes, so the result is the value of knowing them and no proof that they are right."""
    from topdress.control.diagnosis.extend import extend, make_planted_effects
    from topdress.control.diagnosis.runs.closed_loop import measure_loop_gain

    effects = make_planted_effects(setup.machine, found)
    # An effect without a size cannot be simulated.
    if not effects:
        return ["", "closed loop: no named effect with a size, so there is nothing to compare"]
    known = extend(setup.machine, found)
    gain = measure_loop_gain(
        setup.machine, known, effects, setup.crop, setup.rule, setup.job, seconds=seconds
    )
    trim = "on" if setup.job.flow_trim else "off"
    lines = [
        "",
        f"closed loop, simulated {seconds:g} s of job {job} ({setup.job.strategy.value}, "
        f"flow trim {trim}), "
        "the sizes found taken for true:",
    ]
    for word, one in (("not known", gain.before), ("known", gain.after)):
        # A job without a target rate has no percentage.
        bias = (
            100.0 * one.bias_kg_ha / one.mean_target_kg_ha if one.mean_target_kg_ha > 0.0 else 0.0
        )
        lines.append(
            f"  {word:9}  mean landed {one.bias_kg_ha:+.2f} kg/ha off ({bias:+.2f} %), rate error "
            f"{one.rate_error_percent:.2f} %, place error {one.place_error_m:.2f} m"
        )
    return lines


def _format_several(found: Diagnosis, several: JointDiagnosis) -> list[str]:
    from topdress.console.reports.diagnosis_text import (
        describe_by_log,
        describe_common,
        summarise_terminal,
    )

    if several.of_a_kind:
        return [*describe_common(several), *describe_by_log(several.each, "")]
    return [*summarise_terminal(found), *describe_by_log(several.each)]


def _write_result(
    found: Diagnosis,
    several: JointDiagnosis | None,
    as_json: Path | None,
    report: Path | None,
    tools: dict[str, Any],
) -> None:
    from topdress.console.reports.diagnosis_text import summarise_terminal
    from topdress.drivers.files.atomic_files import write_atomically

    if sys.stderr.isatty():
        # The escape sequence clears the line of the progress display before the result.
        sys.stderr.write("\r\x1b[K")
    plain = found.to_json() if several is None else several._replace(together=found).to_json()
    if as_json is not None and str(as_json) == "-":
        typer.echo(json.dumps(plain, indent=1))
    else:
        for line in (
            summarise_terminal(found) if several is None else _format_several(found, several)
            # stdout holds either JSON or text, never both.
        ):
            typer.echo(line)
        if as_json is not None:
            write_atomically(as_json, json.dumps(plain, indent=1) + "\n")
    if report is not None:
        from topdress.console.reports.diagnosis_html import make_diagnosis_page

        write_atomically(
            # The date is passed in, since the page makes no use of a clock.
            report,
            make_diagnosis_page(found, tools | {"date": day_clock.read_today().isoformat()}),
        )
        typer.echo(f"report: {report}", err=True)
