"""From the command line to the screens: start or attach to a worker, open a log."""
from __future__ import annotations

import asyncio
import datetime as dt
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import platformdirs

from console.cli.plain_errors import CommandError, need_terminal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from pydantic import BaseModel

    from console.app.services import Services
    from console.link import Where
    from drivers.files.config import Loaded
    from drivers.files.read_log import RunLog
    from drivers.files.setup import Setup


def show_run(config: tuple[str, ...], effects: tuple[str, ...], seed: int, hz: float, log: str | None,
             model_check: bool = False) -> None:
    """The console on the worker that runs, or on one started for it."""
    from console.link import Link, WorkerFailed, find_running
    from console.services.job import JobFiles, Launcher
    from drivers.files.setup import by_kind, setup_of
    found = by_kind(config)
    setup = setup_of(found, dt.date.today())
    need_terminal("topdress run", "topdress simulate runs the loop, topdress serve shows the console in a browser")
    launcher = Launcher(config, effects, seed, hz, log, trouble_path())
    job = JobFiles(launcher)

    async def attach() -> Link:
        where = await asyncio.to_thread(find_running)
        if where is None:
            raise WorkerFailed("no control worker runs")
        return Link(where)

    try:
        running = find_running()
        source = None
        if running is not None:
            launcher.adopt(running.log_path)
            source = Link(running)
        elif job.offer() is None:           # else the console asks whether to go on with it
            source = Link(_beside(launcher.start))
    except WorkerFailed as error:
        raise CommandError(str(error)) from None
    from console.app.app import TopdressApp
    from console.services.live_checker import LiveChecker
    from console.services.settings import settings_store
    TopdressApp(source, start=launcher.link, attach=attach, limits_kg_ha=(0.0, setup.crop.max_rate_kg_ha),
                hopper_kg=setup.machine.flow.full_kg, tour=not config and first_time(),
                services=replace(run_services(setup, found, effects), job=job, settings=settings_store(),
                                 model_check=LiveChecker().latest if model_check else None)).run()


def _beside(start: Callable[[], Where]) -> Where:
    """The worker comes up, a process of its own, while this one imports the console: each takes about as long."""
    with ThreadPoolExecutor(max_workers=1) as beside:
        started = beside.submit(start)
        import console.app.app
        import console.services.calibrate
        import console.services.diagnosis
        import console.services.layers  # noqa: F401
        return started.result()


def run_services(setup: Setup, found: Mapping[str, Loaded[BaseModel]], effects: tuple[str, ...] = ()) -> Services:
    """What the screens of a run can have done.

    found: the configuration files by kind. effects: of the simulated machine.
    """
    from console.app.services import Services
    from console.services.calibrate import calibrate_job
    from console.services.diagnosis import diagnosis_files
    from console.services.field import field_picture
    from console.services.layers import MapLayers
    from console.services.logs import RunLogs
    from drivers.files.kinds import CAB
    cab = found.get(CAB.format)
    board = cab.model.board if cab is not None and isinstance(cab.model, CAB.model) else None
    files = diagnosis_files(found, effects)
    return Services(
        diagnosis=files,
        field=field_picture,
        logs=RunLogs(),
        layers=MapLayers(files),
        calibrate=calibrate_job(setup.machine, board.wheel_circumference_m if board else None),
    )


def first_time() -> bool:
    """Whether this user never saw the console; from now on they did."""
    mark = Path(platformdirs.user_data_dir("topdress", appauthor=False)) / "seen"
    try:
        mark.parent.mkdir(parents=True, exist_ok=True)
        mark.touch(exist_ok=False)
    except OSError:                      # it is there, or no file can be written: no tour either way
        return False
    return True


def show_replay(recorded: RunLog) -> None:
    """The console on a log."""
    from console.app.app import TopdressApp
    from console.app.services import Services
    from console.services.field import field_picture
    from console.services.layers import MapLayers
    from console.services.logs import RunLogs
    from console.services.replay_frames import replay_job
    from console.services.settings import settings_store
    need_terminal("topdress replay", "topdress replay LOG.csv --headless --out NEW.csv")
    TopdressApp(None, replay=replay_job(recorded),
                services=Services(field=field_picture, logs=RunLogs(), layers=MapLayers(),
                                   settings=settings_store())).run()


def trouble_path() -> Path:
    """Where the worker's stderr goes."""
    folder = Path(platformdirs.user_log_dir("topdress", appauthor=False))
    folder.mkdir(parents=True, exist_ok=True)
    return folder / "worker.log"
