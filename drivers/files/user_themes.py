"""Which theme has a user made? NAME.yaml in the folder `themes` changes some colours of a built-in
theme.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator
from topdress.control.frozen_model import FrozenModel
from topdress.drivers.files.config import ConfigError, ConfigKind, load_config

Colour = Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$", description="a colour such as #00518f")]

# Names of colours that the console's styles use.
THEME_COLOURS = (
    "background",
    "surface",
    "panel",
    "foreground",
    "primary",
    "stale",
    "muted",
    "target",
    "red",
    "on-red",
    "amber",
    "on-amber",
    "keybar",
    "on-keybar",
    "keybar-key",
)


class ThemeData(FrozenModel):
    """Theme file "topdress-theme/1"."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,30}$")]
    like: Literal["day", "night", "contrast"]
    # None means the same as the theme named by `like`.
    dark: bool | None = None
    colours: dict[str, Colour] = {}

    @model_validator(mode="after")
    def _check_colours(self) -> ThemeData:
        if self.name in ("day", "night", "contrast"):
            raise ValueError(f"name {self.name}: is a built-in theme; allowed is another name")
        unknown = [name for name in self.colours if name not in THEME_COLOURS]
        if unknown:
            raise ValueError(f"colours.{unknown[0]}: unknown: allowed {', '.join(THEME_COLOURS)}")
        return self


THEME_KIND = ConfigKind("topdress-theme/1", "themes", ThemeData)


def read_themes(folder: Path) -> tuple[tuple[ThemeData, ...], tuple[str, ...]]:
    """Returns the user's themes, and a line for each unreadable file. Never raises."""
    themes: list[ThemeData] = []
    wrong: list[str] = []
    for path in sorted(folder.glob("*.yaml")):
        try:
            themes.append(load_config(path, THEME_KIND).model)
        except ConfigError as error:
            wrong.append(error.lines[0])
    return tuple(themes), tuple(wrong)
