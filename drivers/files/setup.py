"""What a run needs of its configuration files: machine, crop, job, resolved and checked against each other."""
from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel

from control.agronomy.crop import Crop
from control.agronomy.noa import Rule, prepare
from control.field.job import Job
from control.machine.machine import Machine
from drivers.cab_config import CabConfig
from drivers.files.config import ConfigError, Loaded, load, load_any, sha256_of
from drivers.files.kinds import CROP, JOB, KINDS, MACHINE
from drivers.files.prescriptions.for_job import files_of_job
from drivers.files.weather import WeatherError, growing_days

SAME_SHARE = 1e-4           # two figures for one wheel that differ by less are the same


@dataclass(frozen=True, slots=True)
class Setup:
    machine: Machine
    crop: Crop
    rule: Rule
    job: Job
    sha256: dict[str, str]      # configuration file -> checksum; the job's map and plant list too
    folder: Path                # of the job file: what the job names lies beside it
    weather: Path | None        # from which the growing days were counted

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read for it, or will be when its job is worked."""
        return (*map(Path, self.sha256), *files_of_job(self.job, self.folder),
                *(() if self.weather is None else (self.weather,)))


def by_kind(files: Iterable[str]) -> dict[str, Loaded[BaseModel]]:
    """Configuration files in any order, by their `format:`. Raises ConfigError."""
    found: dict[str, Loaded[BaseModel]] = {}
    for file in files:
        kind, loaded = load_any(file, KINDS)
        if kind is CROP:
            raise ConfigError([f"{file}: a crop file: name it in the job file (key crop)"])
        if kind.folder in ("settings", "themes"):
            raise ConfigError([f"{file}: {kind.format} is the console's: allowed are job, machine and cab files"])
        if kind.format in found:
            raise ConfigError([f"{file}: a second file with format {kind.format}: allowed is one"])
        found[kind.format] = loaded
    return found


def setup_of(found: Mapping[str, Loaded[BaseModel]], today: dt.date) -> Setup:
    """The setup of these files; what is not among them is the shipped nominal one. Raises ConfigError."""
    machine, job = (found[kind.format].path if kind.format in found else shipped
                    for kind, shipped in ((MACHINE, "huanghai"), (JOB, "demo")))
    return load_setup(machine, job, today)


def load_setup(machine: str | Path, job: str | Path, today: dt.date) -> Setup:
    """Read a job, the crop it names and a machine. `today` is the day of sensing where the crop gives none.

    Raises ConfigError, one line for each thing that is wrong.
    """
    got_machine = load(machine, MACHINE)
    got_job = load(job, JOB)
    got_crop = load(got_job.model.crop, CROP, beside=got_job.path.parent)
    crop = got_crop.model
    try:
        days = got_job.model.days or growing_days(crop, got_crop.path.parent, today)
        rule = prepare(crop, days, got_job.model.ndvi_nrich)
    except (WeatherError, ValueError) as error:
        raise ConfigError([str(error)]) from error
    folder = got_job.path.parent
    sums = {str(got.path): got.sha256 for got in (got_machine, got_job, got_crop)}
    weather = None if crop.days.weather is None else got_crop.path.parent / crop.days.weather
    return Setup(got_machine.model, crop, rule, got_job.model, sums | _sums_beside(got_job.model, folder), folder,
                 weather)


def wheel_disagreements(cab: Loaded[BaseModel], machine: Machine, machine_path: str) -> list[str]:
    """The wheel stands in the cab file, by which its pulses are counted, and in the machine file, by which all else is
    judged: one line for each figure that is not the same in both."""
    board = cab.model.board if isinstance(cab.model, CabConfig) else None
    if board is None:
        return []
    pairs = (("wheel_circumference_m", board.wheel_circumference_m, machine.speed.wheel_circumference_m),
             ("wheel_pulses_per_turn", board.wheel_pulses_per_turn, machine.speed.pulses_per_turn))
    return [f"{cab.path}: key board.{key}: value {ours:g}: allowed {theirs:g}, as {machine_path} has it (key "
            f"speed.{key.removeprefix('wheel_') if 'pulses' in key else key})"
            for key, ours, theirs in pairs if abs(ours / theirs - 1.0) > SAME_SHARE]


def _sums_beside(job: Job, folder: Path) -> dict[str, str]:
    """Checksums of the single files that a job names; what is not there, or is a folder, is said when it is read."""
    named = [folder / name for name in (job.target.map, job.target.plants) if name is not None]
    return {str(path): sha256_of(path) for path in named if path.is_file()}
