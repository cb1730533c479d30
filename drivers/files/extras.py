"""What to type for a part of topdress that is not installed."""
from __future__ import annotations

import sys
from pathlib import Path


def install_line(extra: str) -> str:
    """Of an extra of pyproject.toml: from the folder of the sources where topdress runs out of one, as after `make`."""
    source = Path(__file__).resolve().parents[2]
    what = f"-e '{source}[{extra}]'" if (source / "pyproject.toml").is_file() else f"'topdress[{extra}]'"
    return f"{sys.executable} -m pip install {what}"
