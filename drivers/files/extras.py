"""The parts of topdress that are installed by themselves (extras of pyproject.toml): which are there, and what to type
for the others."""
from __future__ import annotations

import re
import shutil
import sys
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec

OWN = "topdress"
_OF_EXTRA = re.compile(r"""^(?P<what>[^;]+?)\s*;.*\bextra\s*==\s*['"](?P<extra>[\w-]+)['"]""")
_NAME = re.compile(r"[A-Za-z0-9._-]+")


def requirements(extra: str) -> tuple[str, ...]:
    """Of an extra: packages with their lowest versions (`matplotlib>=3.9`), as topdress was installed with."""
    try:
        found = [_OF_EXTRA.match(one) for one in requires(OWN) or ()]
    except PackageNotFoundError:            # run out of a folder that nobody installed
        return (f"{OWN}[{extra}]",)
    return tuple(one["what"] for one in found if one and one["extra"] == extra)


def name_of(requirement: str) -> str:
    """`matplotlib` of `matplotlib>=3.9`."""
    found = _NAME.match(requirement)
    return found[0] if found else requirement


def version_of(package: str) -> str | None:
    """Installed; None: it is not there."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def install_line(*packages: str) -> str:
    """What installs packages next to topdress, whatever installed topdress: pip of a clone, pipx, uv (which has no pip
    in its environments)."""
    what = " ".join(f"'{one}'" for one in packages)
    if find_spec("pip") is None and shutil.which("uv"):
        return f"uv pip install --python {sys.executable} {what}"
    return f"{sys.executable} -m pip install {what}"


def extra_line(extra: str) -> str:
    """`install_line` of an extra's packages: no package of topdress itself is looked for anywhere."""
    return install_line(*requirements(extra))
