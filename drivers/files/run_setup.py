"""Which configuration does a run need? Machine, crop and job are loaded, completed and checked
against each other.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.growth_stage import GrowthStageComparison, assess_growth
from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.agronomy.product import Product
from topdress.control.field.job import Job, make_rule
from topdress.control.machine.machine import Machine
from topdress.control.machine.product_calibration import apply_product
from topdress.control.orders import CANOPY_SOURCES
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.slave_board import BoardConfig
from topdress.drivers.files.config import LoadedConfig, calc_sha256, load_any_config, load_config
from topdress.drivers.files.config_error import ConfigError
from topdress.drivers.files.config_kinds import (
    CONFIG_KINDS,
    CROP_KIND,
    JOB_KIND,
    MACHINE_KIND,
    PRODUCT_KIND,
)
from topdress.drivers.files.prescriptions.job_targets import list_job_files
from topdress.drivers.files.weather import WeatherError, count_growing_days

# Number of relays of a rate module besides the drive's own.
MAX_MODULE_VALVES = 15
# Relative difference up to which two circumferences of the wheel count as equal.
SAME_WHEEL_TOLERANCE = 1e-4

# A function of this type returns the names of the logs of the job that is continued.
OwnLogsFinder = Callable[[Job], Collection[str]]


def list_no_logs(job: Job) -> Collection[str]:
    """Returns no names, for a job that begins."""
    return ()


@dataclass(frozen=True, slots=True)
class Setup:
    """Holds everything that a run needs."""

    machine: Machine
    crop: Crop
    rule: CropRule
    job: Job
    # Checksums by the name of the configuration file; the job's map and plant list are included.
    sha256: dict[str, str]
    # Folder of the job file, where relative paths of the job begin.
    folder: Path
    # The weather file from which the growing days were counted.
    weather: Path | None
    # The product that defines nitrogen share and flow of crop and machine; None means their own
    # values.
    product: Product | None = None
    # The nitrogen ceiling of the crop's year; None for a job without a ceiling.
    n_year: YearNitrogen | None = None

    @property
    def growth(self) -> GrowthStageComparison | None:
        """The crop's growth stage and its window; None where the crop file has no window."""
        return assess_growth(self.crop.growth_window, self.job.growth, self.rule.days)

    @property
    def files(self) -> tuple[Path, ...]:
        """Returns all files that were read for the setup, or will be read during the job."""
        return (
            *map(Path, self.sha256),
            *list_job_files(self.job, self.folder),
            *(() if self.weather is None else (self.weather,)),
            *(
                ()
                if self.job.nitrogen.record is None
                else (self.folder / self.job.nitrogen.record,)
            ),
        )


def load_by_kind(files: Iterable[str]) -> dict[str, LoadedConfig[BaseModel]]:
    """Returns configuration files, given in any order, by their `format:`. Raises ConfigError."""
    found: dict[str, LoadedConfig[BaseModel]] = {}
    for file in files:
        kind, loaded = load_any_config(file, CONFIG_KINDS)
        # Crop and product belong to the job, so that they cannot contradict it.
        if kind is CROP_KIND:
            raise ConfigError([f"{file}: a crop file: name it in the job file (key crop)"])
        if kind is PRODUCT_KIND:
            raise ConfigError(
                [f"{file}: a product file: name it in the job file (key product_file)"]
            )
        if kind.folder in ("settings", "themes"):
            raise ConfigError(
                [f"{file}: {kind.format} is the console's: allowed are job, machine and cab files"]
            )
        # A second job or machine file would be ignored silently.
        if kind.format in found:
            raise ConfigError([f"{file}: a second file with format {kind.format}: allowed is one"])
        found[kind.format] = loaded
    return found


def build_setup(
    found: Mapping[str, LoadedConfig[BaseModel]],
    today: dt.date,
    own_logs: OwnLogsFinder = list_no_logs,
) -> Setup:
    """Returns the setup of these files; the shipped nominal file replaces each missing file.
    `own_logs` is as in `load_setup`. Raises ConfigError."""
    # Shipped files complete the set, so that the console can start without any file.
    machine, job = (
        found[kind.format].path if kind.format in found else shipped
        for kind, shipped in ((MACHINE_KIND, "huanghai"), (JOB_KIND, "demo"))
    )
    return load_setup(machine, job, today, own_logs)


def load_setup(
    machine: str | Path, job: str | Path, today: dt.date, own_logs: OwnLogsFinder = list_no_logs
) -> Setup:
    """Returns the setup of a job, the crop and the product that it names, and a machine.

    Parameters
    ----------
    machine : path or shipped name.
    job : path or shipped name.
    today : day of sensing where the crop gives none.
    own_logs : returns the names of the logs of the continued job, whose worked ground gets no more.

    Returns
    -------
    everything that a run needs.

    Raises
    ------
    ConfigError : a line for each error.
    """
    got_machine = load_config(machine, MACHINE_KIND)
    got_job = load_config(job, JOB_KIND)
    # Relative names in a job begin at the job file.
    got_crop = load_config(got_job.model.crop, CROP_KIND, base=got_job.path.parent)
    got_product = load_job_product(got_job.model, got_job.path.parent)
    product = None if got_product is None else got_product.model
    crop, spreader = got_crop.model, got_machine.model
    try:
        # The product changes crop and machine before any rule is derived from them.
        if product is not None:
            crop = crop.model_copy(
                update={"product": product.name, "product_n_fraction": product.n_fraction}
            )
            spreader = apply_product(spreader, product)
        days = got_job.model.days or count_growing_days(
            _apply_job_dates(crop, got_job.model), got_crop.path.parent, today
        )
        n_year = find_year_nitrogen(got_job, crop, today, own_logs)
        # The ceiling of the year limits the rule before rates are computed.
        crop = crop if n_year is None else crop.limit_rates(n_year.most_kg_ha)
        rule = make_rule(crop, got_job.model, days)
    except (WeatherError, ValueError, OSError) as error:
        raise ConfigError([str(error)]) from error
    folder = got_job.path.parent
    sums = {
        # Checksums record exactly which versions of the files a run used.
        str(got.path): got.sha256
        for got in (got_machine, got_job, got_crop, got_product)
        if got is not None
    }
    # A missing file, or a folder, is reported when it is read.
    named = {
        str(path): calc_sha256(path)
        for name in got_job.model.named_files
        if (path := folder / name).is_file()
    }
    # The weather file's path is relative to the crop file.
    stated = None if crop.days is None else crop.days.weather
    weather = None if stated is None else got_crop.path.parent / stated
    return Setup(
        spreader, crop, rule, got_job.model, sums | named, folder, weather, product, n_year
    )


class YearNitrogen(NamedTuple):
    """Holds the nitrogen of a field's year, kg/ha. `earlier_kg_ha` comes from the farm record;
    `n_fraction` belongs to the product."""

    ceiling_kg_ha: float
    given_kg_ha: float
    earlier_kg_ha: float
    passes: int
    n_fraction: float

    @property
    def left_kg_ha(self) -> float:
        """The nitrogen that may still be given, kg/ha."""
        # A negative remainder would become a negative rate.
        return max(0.0, self.ceiling_kg_ha - self.given_kg_ha - self.earlier_kg_ha)

    @property
    def most_kg_ha(self) -> float:
        """The highest permitted rate of the product at any place, kg/ha."""
        return self.left_kg_ha / self.n_fraction

    @property
    def text(self) -> str:
        """Description of the remaining nitrogen."""
        return (
            f"nitrogen.year_max_kg_ha {self.ceiling_kg_ha:g}: {self.given_kg_ha:g} given, "
            f"{self.earlier_kg_ha:.1f} by {self.passes} recorded passes: "
            f"{self.left_kg_ha:.1f} kg N/ha left, "
            f"at most {self.most_kg_ha:.1f} kg/ha of product"
        )


def find_year_nitrogen(
    job: LoadedConfig[Job], crop: Crop, today: dt.date, own_logs: OwnLogsFinder = list_no_logs
) -> YearNitrogen | None:
    """Returns the nitrogen that remains below the job's ceiling.

    Parameters
    ----------
    job : job with its ceiling and farm record.
    crop : crop with its product's share of nitrogen.
    today : the year of nitrogen begins on the first of January of its year, unless the job defines
    another day.
    own_logs : as in `load_setup`.

    Returns
    -------
    None where the job has no ceiling.

    Raises
    ------
    ValueError : no nitrogen remains, or the farm record cannot be assigned to the field.
    """
    wanted, ground = job.model.nitrogen, job.model.field
    if wanted.year_max_kg_ha is None:
        return None
    earlier_kg_ha, passes = 0.0, 0
    if wanted.record is not None:
        from topdress.drivers.files.farm_lines import sum_year_nitrogen

        boundary = ground.make_boundary()
        # Without area and name the records of the field cannot be found.
        if boundary is None or not ground.title:
            raise ValueError(
                f"{job.path}: key nitrogen.record: needs field.title and field.boundary_m: which "
                "lines of it are this field's, and over how many hectares"
            )
        begins = wanted.year_from or dt.date(today.year, 1, 1)
        names = {"client": job.model.client, "farm": job.model.farm, "field": ground.title}
        earlier_kg_ha, passes = sum_year_nitrogen(
            job.path.parent / wanted.record, names, begins, boundary.area_ha, own_logs(job.model)
        )
    found = YearNitrogen(
        wanted.year_max_kg_ha, wanted.given_kg_ha, earlier_kg_ha, passes, crop.product_n_fraction
    )
    # Starting a job that may apply nothing is an error, not an empty job.
    if found.left_kg_ha <= 0.0:
        raise ValueError(
            f"{job.path}: key {found.text}: nothing may be given any more in this year"
        )
    return found


def _apply_job_dates(crop: Crop, job: Job) -> Crop:
    """Returns the crop with the job's dates of sowing and sensing, where the crop counts days from
    dates."""
    dates = {
        name: date
        for name, date in (("sown", job.sown), ("sensed", job.sensed))
        if date is not None
    }
    # A fixed number of days does not depend on dates.
    if crop.days is None or crop.days.count is not None or not dates:
        return crop
    return crop.model_copy(update={"days": crop.days.model_copy(update=dates)})


def describe_growth(growth: GrowthStageComparison | None) -> str:
    """Returns a note about the crop's stage; empty inside of its window, and for a crop without a
    window."""
    if growth is None or (growth.stage is not None and not growth.is_outside):
        return ""
    window = f"the crop file's rule holds from {growth.scale} {growth.first:g} to {growth.last:g}"
    if growth.stage is None:
        return f"growth stage not said (key growth, scale {growth.scale}): {window}"
    return f"growth stage {growth.scale} {growth.stage:g} is outside: {window}"


def load_job_product(job: Job, folder: Path) -> LoadedConfig[Product] | None:
    """Returns the product file that a job names, a path relative to the job or a shipped name; None
    where the job names none. Raises ConfigError."""
    return (
        None
        if job.product_file is None
        else load_config(job.product_file, PRODUCT_KIND, base=folder)
    )


def describe_product(product: Product, machine: Machine) -> str:
    """Returns a note about a product on a machine; empty for a product with a catch test."""
    # A catch test on this machine is better than the product's general number.
    if product.find_newest_test(machine.id) is not None:
        return ""
    return (
        f"product {product.id}: no catch test with machine {machine.id}: its own file's "
        f"{machine.flow.grams_per_rev_mm:g} g per turn and mm counts"
    )


def find_disagreements(
    cab: LoadedConfig[BaseModel], machine: Machine, machine_path: str
) -> list[str]:
    """Returns a line for each contradiction between a cab file and a machine file: different
    wheels, or section valves that no device of the cab drives."""
    config = cab.model if isinstance(cab.model, CabConfig) else None
    if config is None:
        return []
    module, board = config.rate_module, config.board
    lines = []
    # A module has a limited number of relays for valves.
    if (
        machine.switched_strips
        and module is not None
        and module.valves
        and len(machine.switched_strips) > MAX_MODULE_VALVES
    ):
        lines.append(
            f"{cab.path}: key rate_module.valves: value true: allowed for at most "
            f"{MAX_MODULE_VALVES} sections; "
            f"{machine_path} has {len(machine.switched_strips)}"
        )
    elif machine.switched_strips and board is None and not (module is not None and module.valves):
        lines.append(
            f"{cab.path}: key board: missing: allowed a board, or a rate module with "
            "valves: true, for the "
            f"sections' valves of {machine_path}"
        )
    return lines + ([] if board is None else _compare_wheels(cab, board, machine, machine_path))


def _compare_wheels(
    cab: LoadedConfig[BaseModel], board: BoardConfig, machine: Machine, machine_path: str
) -> list[str]:
    pairs = (
        ("wheel_circumference_m", board.wheel_circumference_m, machine.speed.wheel_circumference_m),
        ("wheel_pulses_per_turn", board.wheel_pulses_per_turn, machine.speed.pulses_per_turn),
    )
    return [
        f"{cab.path}: key board.{key}: value {ours:g}: allowed {theirs:g}, as "
        f"{machine_path} has it (key "
        f"speed.{key.removeprefix('wheel_') if 'pulses' in key else key})"
        for key, ours, theirs in pairs
        if abs(ours / theirs - 1.0) > SAME_WHEEL_TOLERANCE
    ]


def find_index_disagreements(
    cab: LoadedConfig[BaseModel] | None, crop: Crop, job: Job
) -> list[str]:
    """Returns a line where the index of the rule differs from the index of the heads. `cab` None
    means simulated heads. A job without canopy sensing needs no index."""
    # Without canopy sensing the index of the heads is not used.
    if job.target.source not in CANOPY_SOURCES:
        return []
    if cab is None:
        if job.simulated.heads_index == crop.index:
            return []
        return [
            f"job {job.id}: key simulated.heads_index: value {job.simulated.heads_index}: "
            f"allowed {crop.index}, "
            f"over which the rule of crop {crop.id} is written"
        ]
    heads = cab.model.heads if isinstance(cab.model, CabConfig) else None
    if heads is None or heads.index == crop.index:
        return []
    return [
        f"{cab.path}: key heads.index: value {heads.index}: allowed {crop.index}, over "
        "which the rule of crop "
        f"{crop.id} is written"
    ]
