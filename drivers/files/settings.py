"""Which settings of the console does a user choose? They are in a single file; a broken file is
reported and not changed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import platformdirs
from pydantic import Field, model_validator
from topdress.control.frozen_model import FrozenModel
from topdress.drivers.files.config import ConfigError, ConfigKind, load_config, save_config

# Highest rate that may be typed, kg/ha.
MAX_RATE_KG_HA = 2000.0

Keys = Annotated[
    str, Field(min_length=1, max_length=80, description="keys, with commas between them")
]


class ManualRate(FrozenModel):
    """Range of a typed manual rate; the crop's own limit holds too."""

    low_kg_ha: Annotated[float, Field(ge=0.0, le=MAX_RATE_KG_HA)] = 0.0
    high_kg_ha: Annotated[float, Field(ge=0.0, le=MAX_RATE_KG_HA)] = MAX_RATE_KG_HA

    @model_validator(mode="after")
    def _check_order(self) -> ManualRate:
        """Refuses an empty range. Raises ValueError."""
        if self.low_kg_ha >= self.high_kg_ha:
            raise ValueError(
                f"low_kg_ha {self.low_kg_ha:g}: allowed is below high_kg_ha {self.high_kg_ha:g}"
            )
        return self


class Presets(FrozenModel):
    """Rates with keys of their own. The defaults are a light, a middle and a full top dressing of
    urea for winter wheat, of the order of the grades in the decision paper's table (0 to 300
    kg/ha)."""

    first_kg_ha: Annotated[float, Field(ge=0.0, le=MAX_RATE_KG_HA)] = 100.0
    second_kg_ha: Annotated[float, Field(ge=0.0, le=MAX_RATE_KG_HA)] = 150.0
    third_kg_ha: Annotated[float, Field(ge=0.0, le=MAX_RATE_KG_HA)] = 200.0


class Rates(FrozenModel):
    """Rates at which the console updates each kind of panel; slower rates spare a weak computer."""

    numbers_hz: Annotated[float, Field(ge=1.0, le=5.0)] = 5.0
    plots_hz: Annotated[float, Field(ge=0.2, le=2.0)] = 2.0
    maps_hz: Annotated[float, Field(ge=0.1, le=1.0)] = 1.0


Command = Annotated[
    str, Field(max_length=500, description="command that plays it; empty: the terminal's bell")
]


class Sounds(FrozenModel):
    """Commands that play sounds in place of the terminal's bell, where `sound` is on."""

    # The alarm sounds when flow is stopped or about to be stopped.
    alarm: Command = ""
    # The caution sounds when work continues.
    caution: Command = ""


class Settings(FrozenModel):
    """Settings file "topdress-settings/1"; every key may be omitted."""

    units: Literal["metric", "imperial"] = "metric"
    language: Literal["auto", "en", "zh"] = "auto"
    theme: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,30}$")] = "day"
    sound: bool = True
    sounds: Sounds = Sounds()
    manual_rate: ManualRate = ManualRate()
    presets: Presets = Presets()
    console: Rates = Rates()
    keymap: dict[str, Keys] = Field(
        default={}, description="action -> keys, where other than the built-in ones"
    )


class ReadSettings(NamedTuple):
    """Holds the settings to use, and the reason why they are not the file's; empty if they are, or
    if no file exists."""

    settings: Settings
    trouble: str = ""


SETTINGS_KIND = ConfigKind("topdress-settings/1", "settings", Settings)


def find_settings_path() -> Path:
    """Returns the path of this user's settings file."""
    return Path(platformdirs.user_config_dir("topdress", appauthor=False)) / "settings.yaml"


def read_settings(path: Path) -> ReadSettings:
    """Returns the file's settings; the defaults for a missing or broken file. Never raises, never
    writes."""
    if not path.exists():
        return ReadSettings(Settings())
    try:
        return ReadSettings(load_config(path, SETTINGS_KIND).model)
    except ConfigError as error:
        more = f" (+{len(error.lines) - 1})" if len(error.lines) > 1 else ""
        return ReadSettings(Settings(), f"{error.lines[0]}{more}")


def write_settings(path: Path, settings: Settings) -> None:
    """Writes the settings, completely or not at all. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    save_config(
        path,
        settings,
        SETTINGS_KIND,
        "Settings of the topdress console; the console's Settings page writes this file.",
    )
