"""The worker as a program: options, priority, assembly, link, loop; and leaving nothing behind."""

from __future__ import annotations

import contextlib
import os
import secrets
import sys
import time
from collections.abc import Callable, Sequence

from topdress.console import import_hooks
from topdress.console.worker import run_file
from topdress.console.worker.host import Host
from topdress.console.worker.link_server import LinkServer
from topdress.console.worker.options import Options, parse_options
from topdress.console.worker.parts import Assembly
from topdress.console.worker.system import take_priority, take_signals

Clock = Callable[[], float]
Assemble = Callable[[Options, Clock], Assembly]


def main(arguments: Sequence[str], assemble: Assemble) -> int:
    """Run one worker to its end; 0 after a clean stop, 1 with one line on stderr otherwise."""
    options = parse_options(arguments)
    with contextlib.ExitStack() as until_the_end:
        try:
            # before any device is opened
            right = until_the_end.enter_context(run_file.held(options.run_file))
        except OSError as error:
            return refused(error)
        return run(options, assemble, right)


def run(options: Options, assemble: Assemble, right: run_file.Right) -> int:
    """As `main`, where the right to be the worker is `run_file.held` already."""
    # before any thread starts: all inherit it
    why_not = take_priority(os.environ.get("TOPDRESS_FIFO"))
    if why_not:
        print(why_not, file=sys.stderr, flush=True)
    began = time.monotonic()

    def clock() -> float:
        return time.monotonic() - began

    try:
        assembly = assemble(options, clock)
    except (OSError, ValueError) as error:
        return refused(error)
    host = Host(assembly, clock, time.sleep, hz=options.hz, orphan_s=options.orphan_s)
    take_signals(host.stop)
    token = secrets.token_hex(16)
    try:
        link = LinkServer(host, token)
        right.confirm()
        said = run_file.RunFile(right, link.port, token, assembly.names.log_path)
        said.write()
    except OSError as error:
        host.close("failed")
        return refused(error)
    said.start()
    link.start()
    import_hooks.done()
    try:
        host.run()
    finally:
        said.close()
        link.close()
        if assembly.writer.trouble:
            print(f"topdress worker: {assembly.writer.trouble}", file=sys.stderr, flush=True)
    return 0


def refused(error: Exception) -> int:
    """Said in one line; the code with which the process ends."""
    print(f"topdress worker: {error}", file=sys.stderr, flush=True)
    return 1
