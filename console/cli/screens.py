"""How does the command line open the screens? It starts or joins a worker, or opens a log."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import platformdirs
import typer
from topdress.console import fast_imports
from topdress.console.cli.plain_errors import (
    EXIT_CANCELLED,
    CommandError,
    has_terminal,
    need_terminal,
)
from topdress.console.locale import _
from topdress.drivers import day_clock

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from pydantic import BaseModel
    from topdress.console.app.app import TopdressApp
    from topdress.console.app.attach_notice import JoinedMachineFacts
    from topdress.console.app.pages.calibrate.service import CalibrateService
    from topdress.console.app.pages.job.service import JobService, RunningLimits
    from topdress.console.app.pages.map.service import OverlayFiles
    from topdress.console.app.pages.replay.service import LogFiles
    from topdress.console.app.services import Services
    from topdress.console.running import WorkerAddress
    from topdress.console.services.diagnosis import DiagnosisFiles
    from topdress.console.services.launcher import Launcher
    from topdress.drivers.files.config import LoadedConfig
    from topdress.drivers.files.read_log import RunLog
    from topdress.drivers.files.run_setup import Setup

    # The setup, and its configuration files by kind.
    SetupFiles = tuple[Setup, Mapping[str, LoadedConfig[BaseModel]]]


def show_run(
    config: tuple[str, ...],
    effects: tuple[str, ...],
    seed: int,
    hz: float,
    log: str | None,
    model_check: bool = False,
    name: str | None = None,
) -> None:
    """Shows the console on the running worker, or on a worker that is started for it."""
    # The imports begin before anything else, because they take most of the time to the first
    # picture.
    fast_imports.pause_gc_for_imports()
    from topdress.console.running import WorkerFailed, find_running_worker
    from topdress.console.services.launcher import Launcher

    launcher = Launcher(config, effects, seed, hz, log, make_trouble_path(), name)
    coming: Future[WorkerAddress] | None = None
    # Without a terminal no console opens, so no running machine is searched.
    running = find_running_worker() if has_terminal() else None
    if running is None:
        # The worker starts in the background unless the user must first decide about an interrupted
        # job.
        if has_terminal() and not launcher.may_have_offer():
            coming = _start_in_background(
                launcher.start_process
                # The worker reads the files, and refuses wrong ones.
            )
        else:
            _load_setup_files(config)
    joined = None if running is None else _join_running(launcher, running)
    # The terminal is checked after the files, so that a wrong file is reported in a script too.
    need_terminal(
        "topdress run",
        "topdress simulate runs the loop, topdress serve shows the console in a browser",
    )
    from topdress.console.app.app import TopdressApp
    from topdress.console.app.services import make_late_service
    from topdress.console.link import ComingLink, Link
    from topdress.console.services.line_files import StoredGuideLineFiles
    from topdress.console.services.live_checker import LiveChecker
    from topdress.console.services.settings import read_settings_store
    from topdress.console.services.sound_player import SoundPlayer
    from topdress.drivers.files.optional_packages import is_extra_installed

    async def attach_to_running() -> Link:
        # This import comes after the start of the worker, which takes as long to start as the whole
        # console.
        import asyncio

        where = await asyncio.to_thread(find_running_worker)
        if where is None:
            raise WorkerFailed(_("no machine is running"))
        await asyncio.to_thread(launcher.adopt_running_files, where.log_path)
        return Link(where, name)

    def make_job_files() -> JobService:
        from topdress.console.services.job import JobFiles

        return JobFiles(launcher)

    job, lines = make_late_service(make_job_files), StoredGuideLineFiles()
    # The model check computes with numba, which the extra diagnosis installs.
    checked = model_check and is_extra_installed("diagnosis")
    source: Link | None = None
    if running is not None:
        source = Link(running, name)
    # Otherwise the console asks whether to continue the interrupted job.
    elif coming is not None or job.find_offer() is None:
        source = ComingLink(coming or _start_in_background(launcher.start_process), name)
    tour = not config and is_first_time()
    # The setup is read at its first use and once: several pages share it.
    services = make_run_services(
        cache(lambda: _load_running_setup(launcher.config, config)), effects
    )
    app = TopdressApp(
        source,
        start=launcher.start_link,
        attach=attach_to_running,
        tour=tour,
        joined=joined,
        # The question about the job would hide the tour, and has no sense for a running machine.
        ask_job=not config and not tour and running is None and source is not None,
        services=replace(
            services,
            job=job,
            settings=read_settings_store(),
            lines=lines,
            play=SoundPlayer(),
            model_check=LiveChecker().find_departure if checked else None,
            missing=_(
                "The model check is off: the extra diagnosis is not installed (topdress extras)"
            )
            if model_check and not checked
            else "",
        ),
    )
    try:
        run_on_terminal(app)
    finally:
        lines.close_files()
    if app.not_started:
        # If a wrong file was the reason, all of its errors are shown.
        _load_setup_files(config)
        raise CommandError(app.not_started)


def find_own_job(name: str) -> str:
    """Returns the file of one of the user's jobs by its name; paths and shipped names are
    unchanged."""
    from topdress.console.services.launcher import find_data_folder

    own = find_data_folder() / "jobs" / f"{name}.yaml"
    return str(own) if "/" not in name and "\\" not in name and own.is_file() else name


def _join_running(launcher: Launcher, running: WorkerAddress) -> JoinedMachineFacts:
    """Adopts the files of the running worker."""
    from topdress.console.app.attach_notice import JoinedMachineFacts

    named = launcher.config
    unused = launcher.adopt_running_files(running.log_path)
    if unused is None:
        return JoinedMachineFacts(
            running.started, running.log_path, (), named, known=False, named=named
        )
    return JoinedMachineFacts(
        running.started, running.log_path, launcher.config, unused, named=named
    )


def _load_running_setup(theirs: tuple[str, ...], ours: tuple[str, ...]) -> SetupFiles:
    """Returns the readable files of the running machine, because a console that could not open for
    them could not stop the machine. Raises ConfigError."""
    from topdress.drivers.files.config_error import ConfigError

    # The files of the running machine may have been deleted; then those of this command, then the
    # shipped ones serve.
    for config in (theirs, ours, ()):
        try:
            return _load_setup_files(config)
        except ConfigError:
            if not config:
                raise
    raise AssertionError("the last of them is tried or raised")


def _start_in_background(start: Callable[[], WorkerAddress]) -> Future[WorkerAddress]:
    """Starts the worker, a process of its own, while this process imports the console; both take
    about the same time."""
    thread = ThreadPoolExecutor(max_workers=1)
    coming = thread.submit(start)
    # The thread ends by itself after its only task.
    thread.shutdown(wait=False)
    return coming


def _load_setup_files(config: tuple[str, ...]) -> SetupFiles:
    """Returns the setup and its files by kind. Raises ConfigError."""
    from topdress.drivers.files.run_setup import build_setup, load_by_kind

    found = load_by_kind(config)
    return build_setup(found, day_clock.read_today()), found


def make_run_services(files: Callable[[], SetupFiles], effects: tuple[str, ...] = ()) -> Services:
    """Returns the services of the screens of a run. Each service is made, and `files` is read, at
    its first use.

    `effects` are those of the simulated machine.
    """
    from topdress.console.app.services import Services, make_late_service
    from topdress.console.services.field import make_field_picture
    from topdress.console.services.running_limits import read_earlier_run

    def make_calibrate() -> CalibrateService:
        from topdress.console.services.calibrate import make_calibrate_service
        from topdress.drivers.files.config_kinds import CAB_KIND

        setup, found = files()
        cab = found.get(CAB_KIND.format)
        board = (
            cab.model.board if cab is not None and isinstance(cab.model, CAB_KIND.model) else None
        )
        return make_calibrate_service(setup.machine, board.wheel_circumference_m if board else None)

    def make_diagnosis() -> DiagnosisFiles:
        from topdress.console.services.diagnosis import DiagnosisFiles
        from topdress.drivers.files.config_kinds import MACHINE_KIND

        found = files()[1]
        folders = [Path.cwd(), *(loaded.path.parent for loaded in found.values())]
        machine = (
            str(found[MACHINE_KIND.format].path) if MACHINE_KIND.format in found else "huanghai"
        )
        return DiagnosisFiles(folders, machine, effects)

    def make_log_files() -> LogFiles:
        from topdress.console.services.run_logs import RunLogs

        return RunLogs()

    def make_map_layers() -> OverlayFiles:
        from topdress.console.services.overlay_files import StoredOverlayFiles

        return StoredOverlayFiles(diagnosed)

    def find_running_limits(log_path: str) -> RunningLimits:
        from topdress.console.app.pages.job.service import RunningLimits
        from topdress.console.services.running_limits import read_running_limits

        found = read_running_limits(log_path)
        if found is not None:
            return found
        setup = files()[0]
        return RunningLimits(setup.crop.max_rate_kg_ha, setup.machine.flow.full_kg)

    diagnosed = make_late_service(make_diagnosis)
    return Services(
        diagnosis=diagnosed,
        earlier=read_earlier_run,
        at_work=find_running_limits,
        field=make_field_picture,
        logs=make_late_service(make_log_files),
        layers=make_late_service(make_map_layers),
        calibrate=make_late_service(make_calibrate),
    )


def is_first_time() -> bool:
    """Returns whether this user opens the console for the first time, and records the visit."""
    from topdress.console.services.launcher import find_data_folder

    mark = find_data_folder() / "seen"
    try:
        mark.parent.mkdir(parents=True, exist_ok=True)
        # touch() with exist_ok=False both tests and sets the mark, so that two consoles cannot both
        # see the first time.
        mark.touch(exist_ok=False)
    # The mark exists, or no file can be written; both cases skip the tour.
    except OSError:
        return False
    return True


def show_replay(recorded: RunLog) -> None:
    """Shows the console on a log."""
    from topdress.console.app.app import TopdressApp
    from topdress.console.app.services import Services
    from topdress.console.services.field import make_field_picture
    from topdress.console.services.overlay_files import StoredOverlayFiles
    from topdress.console.services.replay_frames import open_replay
    from topdress.console.services.run_logs import RunLogs
    from topdress.console.services.settings import read_settings_store

    need_terminal("topdress replay", "topdress replay LOG.csv --headless --out NEW.csv")
    app = TopdressApp(
        None,
        replay=open_replay(recorded),
        services=Services(
            field=make_field_picture,
            logs=RunLogs(),
            layers=StoredOverlayFiles(),
            settings=read_settings_store(),
        ),
    )
    run_on_terminal(app)


def run_on_terminal(app: TopdressApp) -> None:
    """Shows the console until the user leaves it. Raises typer.Exit if its terminal was closed
    first; the machine or log then continues by its own rules."""
    from topdress.console.app.terminal_watch import leave_with_terminal

    with leave_with_terminal(app.leave_from_thread) as is_gone:
        app.run()
    if is_gone():
        raise typer.Exit(EXIT_CANCELLED)


def make_trouble_path() -> Path:
    """Returns the path of the file with the worker's stderr."""
    folder = Path(platformdirs.user_log_dir("topdress", appauthor=False))
    folder.mkdir(parents=True, exist_ok=True)
    return folder / "worker.log"
