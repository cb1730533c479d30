"""Which optional parts of topdress (extras of pyproject.toml) are installed, and which command
installs the others?
"""

from __future__ import annotations

import re
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path

# Name of the package on package indexes.
OWN_PACKAGE = "topdress"
# Purpose of each extra of pyproject.toml, and the modules whose presence shows that the extra is
# installed.
EXTRAS = {
    "diagnosis": ("diagnosis and its live check", ("numba",)),
    "parquet": ("logs as Parquet, read and written", ("polars",)),
    "serve": ("the console in a browser", ("textual_serve",)),
    "gis": ("KML, KMZ and GeoPackage written", ("pyogrio",)),
    "raster": ("GeoTIFF read", ("rasterio",)),
    "mqtt": ("what the machine does, to an MQTT broker", ("paho",)),
    "fleet": ("a season of logs on many computers", ("distributed", "fsspec", "cryptography")),
}
# Name of the file in every environment that pipx creates; such an environment has no pip if uv
# created it.
PIPX_METADATA = "pipx_metadata.json"
# A requirement in the package's metadata that belongs to an extra.
_EXTRA_REQUIREMENT = re.compile(
    r"""^(?P<what>[^;]+?)\s*;.*\bextra\s*==\s*['"](?P<extra>[\w-]+)['"]"""
)
# This file exists only in a clone.
_PROJECT_FILE = Path(__file__).parents[2] / "pyproject.toml"
# The name of a package before its version.
_PACKAGE_NAME = re.compile(r"[A-Za-z0-9._-]+")


class MissingExtra(ValueError):
    """Reports that a command needs packages that are not installed; its line names the command that
    installs them."""


def is_extra_installed(extra: str) -> bool:
    """Returns whether the extra's modules can be imported, without importing any."""
    return all(find_spec(module) is not None for module in EXTRAS[extra][1])


def require_extras(what: str, *extras: str) -> None:
    """Refuses a command whose extras are missing. `what` is the command's subject. Raises
    MissingExtra."""
    if missing := [extra for extra in extras if not is_extra_installed(extra)]:
        raise MissingExtra(
            f"{what} needs the extra{'s' * (len(missing) > 1)} {' and '.join(missing)}, not "
            "installed: "
            f"{format_extra_line(*missing)}"
        )


def find_extra(module: str) -> str | None:
    """Returns the extra that installs a module; None if no extra does."""
    return next(
        (extra for extra, (_, modules) in EXTRAS.items() if module.partition(".")[0] in modules),
        None,
    )


def list_requirements(extra: str) -> tuple[str, ...]:
    """Returns an extra's packages with their lowest versions (`numba>=0.61`); a clone reads them
    from pyproject.toml."""
    if _PROJECT_FILE.is_file():
        return tuple(
            tomllib.loads(_PROJECT_FILE.read_text(encoding="utf-8"))["project"][
                "optional-dependencies"
            ][extra]
        )
    found = [_EXTRA_REQUIREMENT.match(one) for one in requires(OWN_PACKAGE) or ()]
    return tuple(one["what"] for one in found if one and one["extra"] == extra)


def parse_package_name(requirement: str) -> str:
    """Returns the package name of a requirement: `numba` for `numba>=0.61`."""
    found = _PACKAGE_NAME.match(requirement)
    return found[0] if found else requirement


def find_version(package: str) -> str | None:
    """Returns the installed version; None for a package that is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def find_installer() -> tuple[str, ...]:
    """Returns the command that installs packages next to topdress. The environment shows which:
    pipx keeps a file in it, uv's have no pip, and a clone's has pip."""
    environment = Path(sys.prefix)
    if (environment / PIPX_METADATA).is_file():
        return ("pipx", "inject", environment.name)
    if find_spec("pip") is None:
        return ("uv", "pip", "install", "--python", sys.executable)
    return (sys.executable, "-m", "pip", "install")


def format_install_line(*packages: str) -> str:
    """Returns the command line that installs packages."""
    return " ".join([*find_installer(), *(f"'{one}'" for one in packages)])


def format_extra_line(*extras: str) -> str:
    """Returns the command line that installs the extras' packages without searching topdress itself
    in an index."""
    return format_install_line(*(one for extra in extras for one in list_requirements(extra)))
