"""From the command line to the screens: start or attach to a worker, open a log."""
from __future__ import annotations

import asyncio
import datetime as dt
from pathlib import Path
from typing import TYPE_CHECKING

import platformdirs

from console.cli.plain_errors import CommandError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pydantic import BaseModel

    from console.app.services import Services
    from drivers.files.config import Loaded
    from drivers.files.read_log import RunLog
    from drivers.files.setup import Setup


def show_run(config: tuple[str, ...], effects: tuple[str, ...], seed: int, hz: float, log: str | None) -> None:
    """The console on the worker that runs, or on one started for it."""
    from console.app.app import TopdressApp
    from console.link import Link, WorkerFailed, find_running, start_worker
    from drivers.files.setup import by_kind, setup_of
    found = by_kind(config)
    setup = setup_of(found, dt.date.today())
    arguments = [*_pairs("--config", config), *_pairs("--effect", effects), "--seed", str(seed), "--hz", f"{hz:g}"]
    if log is not None:
        arguments += ["--log", log]

    async def start() -> Link:
        return Link(await asyncio.to_thread(start_worker, arguments, trouble_path()))

    async def attach() -> Link:
        where = await asyncio.to_thread(find_running)
        if where is None:
            raise WorkerFailed("no control worker runs")
        return Link(where)

    try:
        running = find_running()
        source = Link(running if running is not None else start_worker(arguments, trouble_path()))
    except WorkerFailed as error:
        raise CommandError(str(error)) from None
    TopdressApp(source, start=start, attach=attach, limits_kg_ha=(0.0, setup.crop.max_rate_kg_ha),
                hopper_kg=setup.machine.flow.full_kg, tour=not config and first_time(),
                services=run_services(setup, found, effects)).run()


def run_services(setup: Setup, found: Mapping[str, Loaded[BaseModel]], effects: tuple[str, ...] = ()) -> Services:
    """What the screens of a run can have done; found: the configuration files by kind; effects: of the simulated machine.
    """
    from console.app.services import Services
    from console.cli.calibrate_services import calibrate_job
    from console.cli.diagnosis_services import diagnosis_files
    from console.cli.map_services import field_picture
    from drivers.files.kinds import CAB
    cab = found.get(CAB.format)
    board = cab.model.board if cab is not None and isinstance(cab.model, CAB.model) else None
    return Services(
        diagnosis=diagnosis_files(found, effects),
        field=field_picture,
        calibrate=calibrate_job(setup.machine, board.wheel_circumference_m if board else None,
                                board.wheel_pulses_per_turn if board else None),
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
    from console.cli.map_services import field_picture
    from console.cli.replay_frames import replay_job
    TopdressApp(None, replay=replay_job(recorded), services=Services(field=field_picture)).run()


def _pairs(option: str, values: tuple[str, ...]) -> list[str]:
    return [word for value in values for word in (option, value)]


def trouble_path() -> Path:
    """Where the worker's stderr goes."""
    folder = Path(platformdirs.user_log_dir("topdress", appauthor=False))
    folder.mkdir(parents=True, exist_ok=True)
    return folder / "worker.log"
