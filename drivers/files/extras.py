"""The parts of topdress that are installed by themselves (extras of pyproject.toml): which are
there, and what to type for the others."""

from __future__ import annotations

import re
import shutil
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path

OWN = "topdress"
# of pyproject.toml: what one has of each, and the modules that it is asked for by
EXTRAS = {
    "diagnosis": ("diagnosis and its live check", ("numba",)),
    "parquet": ("logs as Parquet, read and written", ("polars",)),
    "serve": ("the console in a browser", ("textual_serve",)),
    "gis": ("KML, KMZ and GeoPackage written", ("pyogrio",)),
    "raster": ("GeoTIFF read", ("rasterio",)),
    "mqtt": ("what the machine does, to an MQTT broker", ("paho",)),
    "fleet": ("a season of logs on many computers", ("distributed", "fsspec", "cryptography")),
}
# in an environment that pipx made; with uv as its back end that has no pip
OF_PIPX = "pipx_metadata.json"
_OF_EXTRA = re.compile(r"""^(?P<what>[^;]+?)\s*;.*\bextra\s*==\s*['"](?P<extra>[\w-]+)['"]""")
_PROJECT = Path(__file__).parents[2] / "pyproject.toml"
_NAME = re.compile(r"[A-Za-z0-9._-]+")


class MissingExtra(ValueError):
    """What was asked for needs packages that are not there: one line with what installs them."""


def is_there(extra: str) -> bool:
    """Whether its modules can be imported; none is."""
    return all(find_spec(module) is not None for module in EXTRAS[extra][1])


def need(what: str, *extras: str) -> None:
    """Raises MissingExtra where one of them is not there. what: was asked for, as its subject."""
    if missing := [extra for extra in extras if not is_there(extra)]:
        raise MissingExtra(
            f"{what} needs the extra{'s' * (len(missing) > 1)} {' and '.join(missing)}, not "
            "installed: "
            f"{extra_line(*missing)}"
        )


def extra_of(module: str) -> str | None:
    """The extra that brings a module."""
    return next(
        (extra for extra, (_, modules) in EXTRAS.items() if module.partition(".")[0] in modules),
        None,
    )


def requirements(extra: str) -> tuple[str, ...]:
    """Of an extra: packages with their lowest versions (`numba>=0.61`); of a clone as it
    stands now."""
    if _PROJECT.is_file():
        return tuple(
            tomllib.loads(_PROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"][
                extra
            ]
        )
    found = [_OF_EXTRA.match(one) for one in requires(OWN) or ()]
    return tuple(one["what"] for one in found if one and one["extra"] == extra)


def name_of(requirement: str) -> str:
    """`numba` of `numba>=0.61`."""
    found = _NAME.match(requirement)
    return found[0] if found else requirement


def version_of(package: str) -> str | None:
    """Installed; None: it is not there."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def installer() -> tuple[str, ...]:
    """The command that installs packages next to topdress, whatever installed topdress, which is
    seen by where it runs: pipx keeps a file in its environments, those of uv have no pip, and a
    clone's has it."""
    environment = Path(sys.prefix)
    if (environment / OF_PIPX).is_file():
        return ("pipx", "inject", environment.name)
    if find_spec("pip") is None and shutil.which("uv"):
        return ("uv", "pip", "install", "--python", sys.executable)
    return (sys.executable, "-m", "pip", "install")


def install_line(*packages: str) -> str:
    """What is to be typed."""
    return " ".join([*installer(), *(f"'{one}'" for one in packages)])


def extra_line(*extras: str) -> str:
    """`install_line` of their packages: no package of topdress itself is looked for anywhere."""
    return install_line(*(one for extra in extras for one in requirements(extra)))
