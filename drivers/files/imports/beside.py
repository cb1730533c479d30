"""The import file that lies next to a log: its own, or one for all logs of its folder."""
from __future__ import annotations

from pathlib import Path

OWN, OF_FOLDER = ".import.yaml", "import.yaml"


def import_file(log: Path) -> Path | None:
    """`LOG.import.yaml` next to LOG.csv, else `import.yaml` in its folder; None where there is neither."""
    for place in (log.with_suffix(OWN), log.with_name(OF_FOLDER)):
        if place.is_file() and place != log:
            return place
    return None
