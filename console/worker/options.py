"""Parses the worker's options. This module imports little, because it is read before everything
else.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from topdress.console.worker.limits import (
    DEFAULT_TICK_HZ,
    MAX_TICK_HZ,
    MIN_TICK_HZ,
    ORPHAN_TIMEOUT_S,
)


@dataclass(frozen=True, slots=True)
class Options:
    """Holds the options of the worker. `config` lists job, machine, crop and cab files in any
    order; `format:` in each file tells its kind."""

    config: tuple[str, ...]
    run_file: Path
    hz: float = DEFAULT_TICK_HZ
    # None means a new file in the user's data folder.
    log: str | None = None
    # Seed of the simulated machine.
    seed: int = 1
    # Effects ID=SIZE[@ONSET_S][#MEMBER] that are planted in the simulated machine.
    effects: tuple[str, ...] = ()
    orphan_s: float = ORPHAN_TIMEOUT_S
    # Snapshot of the job to resume.
    resume: Path | None = None


def parse_options(arguments: Sequence[str]) -> Options:
    """Parse the command line; a wrong command line ends the process with one line and code 2."""
    parser = argparse.ArgumentParser(
        prog="python -P -m topdress.console.worker", description="The control worker of topdress."
    )
    parser.add_argument(
        "--config",
        action="append",
        default=[],
        metavar="FILE",
        help="job, machine, crop or cab file (repeatable); none: the simulated machine",
    )
    parser.add_argument(
        "--run-file",
        type=Path,
        required=True,
        help="where to say on which port this worker listens",
    )
    parser.add_argument(
        "--hz",
        type=_parse_tick_hz,
        default=DEFAULT_TICK_HZ,
        help=f"ticks a second (default {DEFAULT_TICK_HZ:g})",
    )
    parser.add_argument(
        "--log", metavar="NAME.csv", help="run log (default: a new file in the user's data folder)"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the simulated machine")
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="ID=SIZE",
        help="plant an effect in the simulated machine (repeatable)",
    )
    parser.add_argument(
        "--resume", type=Path, metavar="NAME.resume.json", help="go on with this job, in a new log"
    )
    parser.add_argument("--orphan-s", type=float, default=ORPHAN_TIMEOUT_S, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    return Options(
        config=tuple(given.config),
        run_file=given.run_file,
        hz=given.hz,
        log=given.log,
        seed=given.seed,
        effects=tuple(given.effect),
        orphan_s=given.orphan_s,
        resume=given.resume,
    )


def _parse_tick_hz(text: str) -> float:
    """Parse the tick rate and check its range."""
    hz = float(text)
    if not MIN_TICK_HZ <= hz <= MAX_TICK_HZ:
        raise argparse.ArgumentTypeError(f"{text}: allowed are {MIN_TICK_HZ:g} to {MAX_TICK_HZ:g}")
    return hz
