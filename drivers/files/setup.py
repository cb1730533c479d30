"""What a run needs of its configuration files: machine, crop, job, resolved and checked against each other."""
from __future__ import annotations

import datetime as dt
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from control.agronomy.crop import Crop
from control.agronomy.noa import Rule, prepare
from control.field.job import Job
from control.machine.machine import Machine
from drivers.files.config import ConfigError, load, load_any
from drivers.files.kinds import CROP, JOB, KINDS, MACHINE
from drivers.files.weather import WeatherError, growing_days


@dataclass(frozen=True, slots=True)
class Setup:
    machine: Machine
    crop: Crop
    rule: Rule
    job: Job
    sha256: dict[str, str]      # configuration file -> checksum


def setup_of_files(config: Iterable[str], today: dt.date) -> Setup:
    """The setup that a run with these configuration files would have: kinds by their `format:`, in any order; what is
    not given is the shipped nominal one. Raises ConfigError.
    """
    given: dict[str, Path] = {}
    for where in config:
        kind, loaded = load_any(where, KINDS)
        if kind.format in given:
            raise ConfigError([f"{where}: a second file of kind {kind.format}: allowed is one"])
        given[kind.format] = loaded.path
    return load_setup(given.get(MACHINE.format, "huanghai"), given.get(JOB.format, "demo"), today)


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
    return Setup(got_machine.model, crop, rule, got_job.model,
                 {str(got.path): got.sha256 for got in (got_machine, got_job, got_crop)})
