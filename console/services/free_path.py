"""Names for new files: nothing is overwritten."""
from __future__ import annotations

from pathlib import Path


def free_path(folder: Path, stem: str, *endings: str) -> Path:
    """A file of the first ending whose name nothing has yet with any of the endings."""
    name, number = stem, 2
    while any((folder / f"{name}{ending}").exists() for ending in endings):
        name, number = f"{stem}-{number}", number + 1
    return folder / f"{name}{endings[0]}"
