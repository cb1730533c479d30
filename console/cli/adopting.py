"""What `diagnose --adopt` writes: all that is decided, and of what is undecided only what is picked by its name."""
from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from console.cli.plain_errors import NOT_JUDGED, CommandError, say_notes
from drivers import day_clock

if TYPE_CHECKING:
    from control.diagnosis.result import Cause, Diagnosis
    from control.machine.machine import Machine


def refuse_picks(picked: tuple[str, ...], out: Path | None) -> None:
    """Before minutes of work. Raises CommandError for names that no diagnosis could say."""
    from control.machine.machine import CATALOGUE
    for name in picked:
        if out is None:
            raise CommandError(f"--pick {name}: only --adopt takes up a cause")
        if name not in CATALOGUE:
            raise CommandError(f"--pick {name}: allowed are the names that `topdress effects` lists")


def adopted(found: Diagnosis, machine: Machine, data: list[Path], out: Path, picked: tuple[str, ...] = ()
            ) -> tuple[Diagnosis, Exception | None]:
    """The diagnosis with the machine file that was written, or how the command ends where none was."""
    try:
        return adopt(found, machine, data, out, picked), None
    except (ValueError, OSError, CommandError, typer.Exit) as why:
        return found, why


def adopt(found: Diagnosis, machine: Machine, data: list[Path], out: Path, picked: tuple[str, ...] = ()) -> Diagnosis:
    """Writes the machine file and says on stderr what it takes up, what not and why, and how to take it back.

    Raises ValueError for what holds in a part of the data only, CommandError for a name that cannot be picked,
    typer.Exit where nothing is left to adopt.
    """
    from console.reports.term_words import side_by_side
    from control.diagnosis.extend import extend, refuse_to_adopt
    from control.diagnosis.runs.adoption import adoptable_of
    from drivers.files.config import save, sha256_of
    from drivers.files.kinds import MACHINE
    for cause in found.causes:
        refuse_to_adopt(cause)
    for name in picked:
        _refuse_pick(name, found, out)
    if picked:                      # by name: then not what predicts best without one
        found = dataclasses.replace(found, fitted=None,
                                    terms=tuple(one for one in found.terms if not one.predicts_best))
    chosen = [cause.id for cause in found.causes if _taken_up(cause, picked, found)]
    taken = adoptable_of(found, chosen)
    for name, why in taken.refused:
        typer.echo(f"note: {name} is not adopted: {why}", err=True)
    kept = taken.found.causes
    _say_whole(taken.found)
    _say_terms(found)
    if not kept and not taken.found.terms and taken.found.fitted is None:
        raise _nothing(found, out, bool(taken.refused))
    extended = extend(machine, taken.found, sha256=sha256_of(data[0]), date=day_clock.today().isoformat())
    save(out, extended, MACHINE, _said(kept, picked))
    typer.echo(f"{out}, before -> after (topdress history {shlex.quote(str(out))} --undo --out FILE takes "
               "it back):", err=True)
    typer.echo("\n".join(side_by_side(extended.history[-1])), err=True)
    return dataclasses.replace(found, extended_machine=str(out))


def _taken_up(cause: Cause, picked: tuple[str, ...], found: Diagnosis) -> bool:
    """Whether a cause goes into the file; says why where it does not, and of what was picked that it was."""
    from console.reports.said import undecided
    from control.diagnosis.extend import not_adoptable, taken_whole
    if taken_whole(found, cause):
        return False                # said with the whole
    if why := not_adoptable(cause):
        typer.echo(f"note: {cause.id} is not adopted: {why}", err=True)
        return False
    if not undecided(cause):
        return True
    if cause.id in picked:
        typer.echo(f"note: {cause.id} is adopted as picked, though {_doubt(cause)}", err=True)
        return True
    typer.echo(f"note: {cause.id} is not adopted: {_doubt(cause)}; --pick {cause.id} adopts it all the same", err=True)
    return False


def _doubt(cause: Cause) -> str:
    from console.reports.said import name_of, others
    rivals = ", ".join(name_of(one) for one, _share in others(cause))
    return f"this data cannot tell it from {rivals}" if rivals else "it is only suspected"


def _refuse_pick(name: str, found: Diagnosis, out: Path) -> None:
    """Raises CommandError."""
    from console.reports.said import undecided
    from control.diagnosis.extend import not_adoptable
    own = [cause for cause in found.causes if cause.id == name]
    if any(not not_adoptable(cause) for cause in own):
        return
    offered = ", ".join(dict.fromkeys(one.id for one in found.causes if undecided(one) and not not_adoptable(one)))
    why = f"not found in this data; undecided: {offered or 'nothing'}"
    if own:
        why = not_adoptable(own[0])
    elif any(rival.id == name for cause in found.causes for rival in cause.rivals):
        why = "its size is not known before the run that tells it from its rivals (next run)"
    raise CommandError(f"{out}: not written: --pick {name}: {why}")


def _say_terms(found: Diagnosis) -> None:
    from console.reports.term_words import compensation
    from control.diagnosis.extend import term_not_adoptable
    for one in found.terms:
        why = term_not_adoptable(one)
        word = f"is not adopted: {why}" if why else f"is adopted. {compensation(one.term)}"
        typer.echo(f"note: term {one.term['id']} {word}", err=True)


def _say_whole(found: Diagnosis) -> None:
    from console.reports.said import whole, whole_gain
    if found.fitted is not None:
        say_notes([whole(found.fitted), whole_gain(found.fitted)])


def _nothing(found: Diagnosis, out: Path, refused: bool) -> typer.Exit:
    from control.diagnosis.extend import adoptable
    why = "no effect and no term was found that a machine file could take up"
    if refused:
        why = "a machine file with what was found would predict no better"
    elif adoptable(found):
        why = "what was found is undecided, and nothing of it was picked"
    typer.echo(f"{out}: not written: {why}", err=True)
    return typer.Exit(NOT_JUDGED)


def _said(kept: tuple[Cause, ...], picked: tuple[str, ...]) -> str:
    """For the file: what was picked against the data's silence."""
    from console.reports.said import undecided
    return "\n".join(f"{cause.id}: picked by name (diagnose --pick), though {_doubt(cause)}."
                     for cause in kept if undecided(cause) and cause.id in picked)
