"""How does the console start control workers, and with which files?

The module imports little, because the worker is started before the console has imported its pages.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import platformdirs
from topdress.console.running import WorkerAddress, start_worker
from topdress.console.worker.snapshots import may_have_open_job

if TYPE_CHECKING:
    from topdress.console.link import Link


def find_data_folder() -> Path:
    """Returns the user's own folder for files that the program writes."""
    return Path(platformdirs.user_data_dir("topdress", appauthor=False))


class Launcher:
    """Starts control workers with the files that were chosen last."""

    def __init__(
        self,
        config: Sequence[str],
        effects: Sequence[str],
        seed: int,
        hz: float,
        log: str | None,
        trouble: Path,
        name: str | None = None,
    ) -> None:
        self.config, self.effects, self.seed, self.hz, self.log = (
            tuple(config),
            tuple(effects),
            seed,
            hz,
            log,
        )
        self.trouble, self.name = trouble, name

    def start_process(self, resumed: Path | None = None) -> WorkerAddress:
        """Starts a worker and waits until it listens; `resumed` is the snapshot of the job to
        continue. Raises WorkerFailed."""
        arguments = [
            *_repeat_option("--config", self.config),
            *_repeat_option("--effect", self.effects),
            "--seed",
            str(self.seed),
            "--hz",
            f"{self.hz:g}",
        ]
        if self.log is not None:
            arguments += ["--log", self.log]
        if resumed is not None:
            arguments += ["--resume", str(resumed)]
        return start_worker(arguments, self.trouble)

    async def start_link(self, resumed: Path | None = None) -> Link:
        """Starts a worker and connects to it."""
        import asyncio

        from topdress.console.link import Link

        return Link(await asyncio.to_thread(self.start_process, resumed), self.name)

    @property
    def log_folder(self) -> Path:
        """The folder in which logs are written."""
        return find_data_folder() / "logs" if self.log is None else Path(self.log).parent

    def adopt_running_files(self, log_path: str) -> tuple[str, ...] | None:
        """Adopts the files of a worker that already runs: its log's sidecar names them.

        Returns those of this console's files with which the worker does not run; None for an
        unreadable sidecar, which changes nothing.
        """
        from topdress.drivers.files.config import load_any_config
        from topdress.drivers.files.config_error import ConfigError
        from topdress.drivers.files.config_kinds import (
            CAB_KIND,
            CONFIG_KINDS,
            JOB_KIND,
            MACHINE_KIND,
        )
        from topdress.drivers.files.run_meta import read_sidecar_meta

        meta = read_sidecar_meta(log_path)
        if meta is None:
            return None
        found = []
        for file in meta.sha256:
            try:
                kind, _loaded = load_any_config(Path(file), CONFIG_KINDS)
            except ConfigError:
                continue
            if kind in (JOB_KIND, MACHINE_KIND, CAB_KIND):
                found.append(file)
        unused = list_other_files(found, self.config)
        self.config = tuple(found)
        return unused

    def may_have_offer(self) -> bool:
        """Returns whether an interrupted job may exist that `JobFiles.find_offer` must check."""
        return may_have_open_job(self.log_folder)


def list_other_files(theirs: Sequence[str], ours: Sequence[str]) -> tuple[str, ...]:
    """Returns those of `ours` that are not among `theirs`; shipped files match by name or path."""
    known = {
        path for file in theirs for path in (Path(file).resolve(), _find_shipped_file(file))
    } - {None}
    return tuple(
        file for file in ours if not known & {Path(file).resolve(), _find_shipped_file(file)}
    )


def _repeat_option(option: str, values: Sequence[str]) -> list[str]:
    return [word for value in values for word in (option, value)]


def _find_shipped_file(file: str) -> Path | None:
    """Returns the shipped file of this name; None for an unknown name."""
    from topdress.drivers.files.config import resolve_config_path
    from topdress.drivers.files.config_error import ConfigError
    from topdress.drivers.files.config_kinds import CONFIG_KINDS

    try:
        return resolve_config_path(file, [kind.folder for kind in CONFIG_KINDS.values()]).resolve()
    except ConfigError:
        return None
