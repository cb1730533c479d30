"""How do `topdress info` and `topdress extras` list the installation, for reports of faults and for
missing parts?
"""

from __future__ import annotations

import os
import platform
import shutil
import sys
from importlib.metadata import requires
from typing import Any

import typer
from topdress.console.cli.plain_output import AsJson, print_json


def list_extras(as_json: AsJson = False) -> None:
    """Say which parts are installed, and what installs the others."""
    found = _list_extra_states()
    if as_json:
        print_json(found)
        return
    for one in found:
        state = "installed" if one["installed"] else f"not installed: {one['line']}"
        typer.echo(f"{one['extra']:9} {one['for']}: {state}")


def print_info(as_json: AsJson = False) -> None:
    """Say versions, folders, ports and screen of this installation, for a report of trouble.
    Nothing is opened."""
    from serial.tools.list_ports import comports

    found: dict[str, dict[str, Any]] = {
        "topdress": _find_versions(),
        "computer": {
            "system": platform.platform(),
            "machine": platform.machine(),
            "cores": os.cpu_count() or 0,
            "interpreter": sys.executable,
        },
        "folders": _find_folders(),
        "ports": {one.device: one.description or "" for one in sorted(comports())},
        "screen": _describe_screen(),
        "extras": {
            one["extra"]: "installed" if one["installed"] else one["line"]
            for one in _list_extra_states()
        },
    }
    if as_json:
        print_json(found)
        return
    for title, of in found.items():
        typer.echo(title)
        for name, said in of.items():
            typer.echo(f"  {name:20} {said}")


def _find_versions() -> dict[str, str]:
    from topdress.drivers.files.optional_packages import (
        OWN_PACKAGE,
        find_version,
        parse_package_name,
    )
    from topdress.drivers.files.run_meta import find_software_version

    names = (
        [
            parse_package_name(one)
            for one in requires(OWN_PACKAGE) or ()
            if "extra" not in one and "sys_platform" not in one
        ]
        if find_version(OWN_PACKAGE)
        else []
    )
    return {
        OWN_PACKAGE: find_software_version(),
        "python": platform.python_version(),
        **{name: find_version(name) or "not there" for name in names},
    }


def _find_folders() -> dict[str, str]:
    from pathlib import Path

    from topdress.console.services.launcher import find_data_folder
    from topdress.drivers.files.settings import find_settings_path

    return {
        "sources": str(Path(__file__).resolve().parents[2]),
        "settings": str(find_settings_path()),
        "data": str(find_data_folder()),
    }


def _describe_screen() -> dict[str, Any]:
    size = shutil.get_terminal_size()
    return {
        "size": f"{size.columns}x{size.lines}",
        "terminal": sys.stdout.isatty(),
        **{
            name: os.environ.get(name, "")
            for name in ("TERM", "COLORTERM", "LANG", "TMUX", "SSH_TTY")
        },
        "encoding": sys.stdout.encoding,
    }


def _list_extra_states() -> list[dict[str, Any]]:
    from topdress.drivers.files.optional_packages import (
        EXTRAS,
        format_extra_line,
        is_extra_installed,
    )

    return [
        {
            "extra": extra,
            "for": words,
            "installed": is_extra_installed(extra),
            "line": format_extra_line(extra),
        }
        for extra, (words, _) in EXTRAS.items()
    ]
