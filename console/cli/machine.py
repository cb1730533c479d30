"""How does `topdress machine --from LOG` make a first machine file of one stage? It requests the
facts that the log does not contain.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from topdress.console.cli.calibrate import EffortUnit
from topdress.console.cli.outputs import ForceOption, Output, list_log_files, refuse_collisions
from topdress.console.cli.plain_errors import CommandError

if TYPE_CHECKING:
    from topdress.control.calibration.first_machine import MachineSuggestion

# Time constant of a small drive, s, where neither the log nor the user gives one.
DEFAULT_TIME_CONSTANT_S = 0.05
# Relative uncertainty of times from a log, caused by the interval of rows or by a drive that is not
# exactly of first order.
TIME_TOLERANCE = 0.05
# Beginning of the comment by which an earlier output is recognised.
HEAD_COMMENT = "Made by topdress machine from"


class DriveTarget(StrEnum):
    """Lists the parts that a drive moves."""

    PUMP = "pump"
    WHEEL = "wheel"
    FAN = "fan"
    CONVEYOR = "conveyor"


class Questionnaire:
    """Asks questions on the terminal; `count` is the number of questions asked."""

    def __init__(self, ask: bool) -> None:
        self.ask, self.count = ask, 0

    def ask_number(self, given: float | None, question: str, usual: float) -> float:
        """Returns the given number, else the answer."""
        if given is not None or not self.ask:
            # Without questions the suggestion of the log is taken.
            return usual if given is None else given
        self.count += 1
        while True:
            value: float = typer.prompt(
                # Four digits are enough for an answer, and a long default would be hard to compare.
                question,
                default=float(f"{usual:.4g}"),
                type=float,
                err=True,
                # Questions go to stderr, so that stdout stays free for the result.
            )
            if value > 0.0:
                return value
            typer.echo(f"value {value:g}: allowed more than 0", err=True)

    def ask_effort_unit(
        self, given: EffortUnit | None, columns: Mapping[str, Any]
    ) -> EffortUnit | None:
        """Returns the unit of the log's effort; None if the effort is no reference."""
        if given is not None or not self.ask or "shaft_effort" not in columns:
            return given
        self.count += 1
        units = [*EffortUnit, "none"]
        while True:
            said = typer.prompt(
                f"How hard it works, of a sound drive, in ({', '.join(units)})",
                default="%",
                err=True,
            )
            if said in units:
                return None if said == "none" else EffortUnit(said)
            typer.echo(f"{said}: allowed {', '.join(units)}", err=True)

    def ask_yes_no(self, given: bool | None, question: str, usual: bool) -> bool:
        """Returns the given choice, else the answer."""
        if given is not None or not self.ask:
            return usual if given is None else given
        self.count += 1
        return bool(typer.confirm(question, default=usual, err=True))


def make_machine_file(
    *,
    log: Annotated[
        Path,
        typer.Option(
            "--from",
            metavar="LOG",
            help="A log of the drive: its command and what was read of its speed.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="NEW.yaml", help="The machine file.")],
    kind: Annotated[DriveTarget, typer.Option(help="What it drives.")] = DriveTarget.WHEEL,
    full_speed: Annotated[
        float | None,
        typer.Option(
            metavar="RPM",
            min=0.1,
            max=1e5,
            help="Speed at the full command, by its data sheet, r/min.",
        ),
    ] = None,
    settled: Annotated[
        bool | None,
        typer.Option(
            "--settled/--running",
            help="A row holds a command with what it settled at, or the drive while it runs.",
        ),
    ] = None,
    both_ways: Annotated[
        bool | None, typer.Option("--both-ways/--one-way", help="Whether it turns backwards too.")
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(
            metavar="RPM", min=1e-6, max=1e4, help="Noise of its speed sensor, 1 s.d., r/min."
        ),
    ] = None,
    time_constant: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=1e-4,
            max=3600.0,
            help="Its time constant, s, where the log does not show it.",
        ),
    ] = None,
    effort_unit: Annotated[
        EffortUnit | None,
        typer.Option(
            help="Of `shaft_effort`, where the log has it and the drive "
            "was sound: later logs are held against it."
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Ask nothing: what the log suggests is taken.")
    ] = False,
    force: ForceOption = False,
) -> None:
    """Write a first machine file of one stage from a log, asking full speed, rows, direction
    and sensor noise, the time constant where the log does not show it, and in what its effort
    is where it has one."""
    import numpy as np
    from topdress.control.calibration.first_machine import MissingColumn, suggest_machine
    from topdress.drivers.files.any_log import open_any_log
    from topdress.drivers.files.atomic_files import write_atomically

    if out.suffix not in (".yaml", ".yml"):
        raise CommandError(f"--out {out}: allowed is a name that ends in .yaml")
    # The sidecar NAME.yaml of a log has the suffix of a machine file; it must survive.
    if out.resolve() == list_log_files(log)[1].resolve():
        raise CommandError(f"--out {out}: is the sidecar of the log {log}: allowed is another name")
    refuse_collisions(list_log_files(log), [Output((out,))], force)
    columns = dict(open_any_log(log).columns)
    try:
        found = suggest_machine(columns)
    except MissingColumn as error:
        raise CommandError(
            # The message has the command that solves the problem; the path is quoted for a shell.
            f"{log}: {error}; topdress import {shlex.quote(str(log))} --guess writes an import "
            "file in which a line says which column it is"
        ) from None
    except ValueError as error:
        raise CommandError(f"{log}: {error}") from None
    answers = Questionnaire(not yes)
    made = _ask_missing(found, answers, full_speed, settled, both_ways, noise, time_constant)
    text = format_machine_file(made, kind, f"{HEAD_COMMENT} {log.name}")
    text = _add_effort_reference(
        text, columns, answers.ask_effort_unit(effort_unit, columns), log.name
    )
    _refuse_invalid(text, out)
    write_atomically(out, text)
    row_s = float(np.median(np.diff(columns["time_s"])))
    times = _describe_times(found, made, answers.ask or time_constant is not None, row_s)
    typer.echo(
        f"{out}: a {kind.value}, {made.full_rpm:g} "
        f"r/min{times}{_describe_neutral(made)}; {answers.count} "
        f"questions; next: topdress diagnose {log} --machine {out}"
    )


def _refuse_invalid(text: str, out: Path) -> None:
    """Raises CommandError, one line, where no machine file may have the numbers of a text."""
    import yaml
    from pydantic import ValidationError
    from topdress.control.machine.machine import Machine

    try:
        Machine.model_validate(yaml.safe_load(text))
    except ValidationError as error:
        first = error.errors()[0]
        context = first.get("ctx", {})
        place = ".".join(map(str, context.get("wrong_key", first["loc"])))
        raise CommandError(
            f"{out}: not written: {place}: {context.get('allowed', first['msg'])}; are command and "
            "reading in r/min of one side?"
        ) from None


def _ask_missing(
    found: MachineSuggestion,
    answers: Questionnaire,
    full_speed: float | None,
    settled: bool | None,
    both_ways: bool | None,
    noise: float | None,
    time_constant: float | None,
) -> MachineSuggestion:
    full = answers.ask_number(
        full_speed, "Speed at the full command, by its data sheet, r/min", found.full_rpm
    )
    rows = answers.ask_yes_no(
        settled,
        "Does a row hold a command with what it settled at (no: the drive while it runs)",
        found.settled,
    )
    both = answers.ask_yes_no(both_ways, "Does it turn backwards too", found.both_ways)
    if both_ways is None and not answers.ask:
        # A log in one direction does not show whether the drive can reverse.
        both = True
    sd = answers.ask_number(noise, "Noise of its speed sensor, 1 s.d., r/min", found.noise_rpm)
    # In a table of settled values nothing moves, so the drive has no time constant.
    tau_s = 0.0 if rows else found.tau_s if time_constant is None else time_constant
    if tau_s is None:
        tau_s = answers.ask_number(
            None,
            "Time constant of the drive, s (this log does not show it)",
            DEFAULT_TIME_CONSTANT_S,
        )
    return found._replace(
        full_rpm=full,
        settled=rows,
        both_ways=both,
        noise_rpm=sd,
        dead_s=found.dead_s or 0.0,
        tau_s=tau_s,
    )


def _add_effort_reference(
    text: str, columns: Mapping[str, Any], unit: EffortUnit | None, name: str
) -> str:
    """Returns the file with the drive's own effort from its log. Raises ValueError, one line, where
    the log does not show it."""
    import yaml
    from topdress.control.diagnosis.runs.effort_reference import fit_effort
    from topdress.control.machine.effort import Effort
    from topdress.control.machine.machine import Machine

    if unit is None:
        return text
    fitted, _fits = fit_effort(
        columns, Machine.model_validate(yaml.safe_load(text)), name, unit=unit.value
    )
    parts = ", ".join(
        f"{part}: {value:.4g}"
        for part, value in fitted.effort._asdict().items()
        if value != Effort._field_defaults[part]
    )
    # The text is changed in place, so that the order and the comments of the file stay.
    text = text.replace("stages: [shaft]", "stages: [shaft, effort]")
    text = text.replace("noise: {", f"noise: {{effort: {fitted.noise.effort:.3g}, ")
    return text + f'effort_unit: "{unit.value}"\neffort: {{{parts}}}\n'


def _describe_times(
    found: MachineSuggestion, made: MachineSuggestion, asked: bool, row_s: float
) -> str:
    """Returns the source of the drive's times, in words; rows `row_s` apart show no shorter one."""
    if made.settled or made.tau_s is None:
        return ""
    if made.tau_s != found.tau_s:
        if found.tau_s is not None:
            return f", time constant {made.tau_s:.3g} s as given, {found.tau_s:.3g} s by the log"
        source = "as answered" if asked else "a small drive's"
        return f", time constant {made.tau_s:.3g} s, {source}: the log does not show it"
    times = " and ".join(
        f"{word} {time_s:.3g} s" if time_s > 0.0 else f"{word} below a row ({row_s:.3g} s)"
        for word, time_s in (("time constant", made.tau_s), ("dead time", made.dead_s or 0.0))
    )
    return f", {times} as the log shows them"


def _describe_neutral(made: MachineSuggestion) -> str:
    """Returns the command at standstill in words, where it is not 0."""
    if made.neutral is None:
        return ""
    return f", stands at a command of {made.neutral.rpm:.4g} as the log shows it" + (
        ", slower the higher its command" if made.neutral.falls else ""
    )


def format_machine_file(made: MachineSuggestion, kind: DriveTarget, head: str) -> str:
    """Returns the text of the file: its description, parts, limits and sensors. Neutral numbers are
    omitted."""
    dead_s, tau_s = made.dead_s or 0.0, made.tau_s or 0.0
    # No acceleration limit is known from such a log, so a very large one leaves it without effect.
    shaft = [f"full_rpm: {made.full_rpm:g}", "acceleration_rpm_s: 1.0e+6"]
    if not made.settled:
        shaft += [f"dead_time_s: {dead_s:.3g}", f"time_constant_s: {max(tau_s, 1e-3):.3g}"]
    else:
        shaft += ["dead_time_s: 0", "time_constant_s: 0.001"]
    if not made.both_ways:
        shaft.append("one_way: 1")
    if made.neutral is not None:
        shaft.append(f"neutral_rpm: {made.neutral.rpm:.4g}")
        # -200 % turns the sign: a drive that slows with a higher command.
        shaft += ["gain_percent: -200"] if made.neutral.falls else []
        shaft += ["zero_stops: 0"] if made.neutral.zero_turns else []
    # Voltages outside of 1 to 60 V are no supply of a vehicle but a wrong column.
    if made.supply_v is not None and 1.0 <= made.supply_v <= 60.0:
        shaft.append(f"nominal_supply_v: {made.supply_v:.3g}")
    lines = [
        f"# {head}: what was answered, and what the log itself shows of the times.",
        "format: topdress-machine/1",
        f"id: {kind.value}",
        "stages: [shaft]",
        f"shaft: {{{', '.join(shaft)}}}",
        f"limits: {{shaft_low_rpm: 0, shaft_high_rpm: {made.full_rpm:g}}}",
        f"noise: {{shaft_rpm: {made.noise_rpm:.3g}}}",
        # The tolerance of a time has a floor, since short times cannot be known to 5 %.
        f"tolerance: {{shaft_percent: 0.5, dead_time_s: {max(0.01, TIME_TOLERANCE * dead_s):.3g}, "
        f"time_constant_s: {max(0.015, TIME_TOLERANCE * tau_s):.3g}}}     # of a first file",
    ]
    return "\n".join(lines) + "\n"
