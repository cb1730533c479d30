"""Runs the worker as a program: options, priority, assembly, link, loop, and cleanup."""

from __future__ import annotations

import contextlib
import os
import secrets
import sys
import time
from collections.abc import Callable, Sequence

from topdress.console import fast_imports
from topdress.console.worker import run_file
from topdress.console.worker.link_server import LinkServer
from topdress.console.worker.loop_host import Host
from topdress.console.worker.options import Options, parse_options
from topdress.console.worker.real_time import handle_signals, set_priority
from topdress.console.worker.run_interfaces import RunAssembly

Clock = Callable[[], float]
Assemble = Callable[[Options, Clock], RunAssembly]


def run_worker_program(arguments: Sequence[str], assemble: Assemble) -> int:
    """Run one worker to its end; return 0 after a clean stop, 1 with one line on stderr otherwise.

    Parameters
    ----------
    arguments
        Command line without the program's name.
    assemble
        Builds the parts of the run.
    """
    options = parse_options(arguments)
    with contextlib.ExitStack() as until_the_end:
        try:
            # The right is taken before any device is opened: two workers must not share a port.
            right = until_the_end.enter_context(run_file.hold_right(options.run_file))
        except OSError as error:
            return report_refusal(error)
        return run_with_right(options, assemble, right)


def run_with_right(options: Options, assemble: Assemble, right: run_file.WorkerLock) -> int:
    """Run one worker as `run_worker_program` does, with the right to be the worker already
    taken."""
    # The priority is set before any thread starts, because threads inherit it.
    why_not = set_priority(os.environ.get("TOPDRESS_FIFO"))
    if why_not:
        print(why_not, file=sys.stderr, flush=True)
    began = time.monotonic()

    def read_run_time_s() -> float:
        return time.monotonic() - began

    try:
        assembly = assemble(options, read_run_time_s)
    except (OSError, ValueError) as error:
        return report_refusal(error)
    host = Host(assembly, read_run_time_s, time.sleep, hz=options.hz, orphan_s=options.orphan_s)
    handle_signals(host.request_stop)
    token = secrets.token_hex(16)
    try:
        link = LinkServer(host, token)
        # The right is confirmed after the slow assembly, immediately before other programs can see
        # this worker.
        right.confirm_right()
        said = run_file.RunFileWriter(right, link.port, token, assembly.names.log_path)
        said.write_run_file()
    except OSError as error:
        host.close_run("failed")
        return report_refusal(error)
    # The run file comes before the link serves, so that a console that reads the file can connect.
    said.start()
    link.start()
    fast_imports.resume_gc()
    try:
        host.run_until_stopped()
    finally:
        said.stop_writing()
        link.close_link()
        if assembly.writer.trouble:
            print(f"topdress worker: {assembly.writer.trouble}", file=sys.stderr, flush=True)
    return 0


def report_refusal(error: Exception) -> int:
    """Print why the worker ends, in one line, and return the exit code."""
    print(f"topdress worker: {error}", file=sys.stderr, flush=True)
    return 1
