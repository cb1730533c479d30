"""How control workers are started from the console, and with which files.

Light: the worker is started before the console has imported its pages.
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
    """The user's own folder for files that the program writes."""
    return Path(platformdirs.user_data_dir("topdress", appauthor=False))


class Launcher:
    """Starts control workers, with the files as they were last chosen."""

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
        """Start a worker and wait until it listens; resumed: the snapshot of the job to go on with.
        Raises WorkerFailed."""
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
        """Start a worker and connect to it."""
        import asyncio

        from topdress.console.link import Link

        return Link(await asyncio.to_thread(self.start_process, resumed), self.name)

    @property
    def log_folder(self) -> Path:
        """The folder in which logs are written."""
        return find_data_folder() / "logs" if self.log is None else Path(self.log).parent

    def adopt_running_files(self, log_path: str) -> tuple[str, ...] | None:
        """Take the files of a worker that runs already: its log's sidecar names them.

        Returns those of ours that it does not run with; None where the sidecar cannot be read: then
        ours stay.
        """
        from topdress.drivers.files.config import load_any_config
        from topdress.drivers.files.config_error import ConfigError
        from topdress.drivers.files.kinds import CAB, JOB, KINDS, MACHINE
        from topdress.drivers.files.run_meta import read_sidecar_meta

        meta = read_sidecar_meta(log_path)
        if meta is None:
            return None
        found = []
        for file in meta.sha256:
            try:
                kind, _loaded = load_any_config(Path(file), KINDS)
            except ConfigError:
                continue
            if kind in (JOB, MACHINE, CAB):
                found.append(file)
        unused = list_other_files(found, self.config)
        self.config = tuple(found)
        return unused

    def may_have_offer(self) -> bool:
        """Whether a job may have been cut off that `JobFiles.find_offer` has to check."""
        return may_have_open_job(self.log_folder)


def list_other_files(theirs: Sequence[str], ours: Sequence[str]) -> tuple[str, ...]:
    """Those of our files that are not among theirs; shipped ones by their names or by their
    paths."""
    known = {
        path for file in theirs for path in (Path(file).resolve(), _find_shipped_file(file))
    } - {None}
    return tuple(
        file for file in ours if not known & {Path(file).resolve(), _find_shipped_file(file)}
    )


def _repeat_option(option: str, values: Sequence[str]) -> list[str]:
    return [word for value in values for word in (option, value)]


def _find_shipped_file(file: str) -> Path | None:
    """The shipped file of this name; None where there is none."""
    from topdress.drivers.files.config import resolve_config_path
    from topdress.drivers.files.config_error import ConfigError
    from topdress.drivers.files.kinds import KINDS

    try:
        return resolve_config_path(file, [kind.folder for kind in KINDS.values()]).resolve()
    except ConfigError:
        return None
