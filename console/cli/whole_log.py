"""How does a computed run log get its name only when it is complete? A cancelled log leaves no
files.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from topdress.console.cli.outputs import Output, list_log_files, list_new_log_files

if TYPE_CHECKING:
    from topdress.drivers.files.run_log import PlainLogWriter
    from topdress.drivers.files.run_meta import RunMeta


@contextlib.contextmanager
def open_whole_log(path: Path, meta: RunMeta) -> Iterator[PlainLogWriter]:
    """Yields a writer whose log and sidecar get their names at the end of the block. Raises
    OSError."""
    from topdress.drivers.files.run_log import PlainLogWriter

    writer = PlainLogWriter(path.with_name(f".{path.stem}.part.csv"), meta)
    part = list_log_files(writer.path)
    try:
        try:
            yield writer
        finally:
            writer.close()
        for file, name in reversed(list(zip(part, list_log_files(path), strict=True))):
            file.replace(name)
    except BaseException:
        for file in part:
            file.unlink(missing_ok=True)
        raise


def make_log_output(log: Path, *with_it: Path) -> Output:
    """Returns the files of a computed log; an existing computed log may be replaced, the log of a
    drive may not.

    Raises CommandError for a name without the suffix of a log.
    """
    return Output((*list_new_log_files(log), *with_it), lambda: _is_computed_log(log))


def _is_computed_log(log: Path) -> bool:
    from topdress.drivers.files.run_meta import read_sidecar_meta

    meta = read_sidecar_meta(log)
    return meta is not None and (
        "replay_of" in meta.extra or (meta.seed is not None and meta.started_utc is None)
    )
