"""This tree and another one, measured by turns in the same run; and the control worker of
either at work."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[1]


def trees(against: Path | None) -> dict[str, Path]:
    """By name, the old one first: what else the computer does meets both alike."""
    return {"old": against.resolve(), "new": HERE} if against is not None else {"new": HERE}


def environment_of(tree: Path, before: Mapping[str, str] = os.environ) -> dict[str, str]:
    """A program started with it takes the code of the tree, and keeps it compiled: else a tree
    in which nobody has yet run anything would be compiled anew by every process, 0.2 s of a
    start."""
    return dict(before) | {
        "PYTHONPATH": str(tree),
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONDONTWRITEBYTECODE": "",
    }


def worked(
    arguments: list[str],
    clock: Callable[[], float],
    wait: Callable[[float], object],
    until_s: float,
    **options: Any,
) -> Any:
    """The host of a control worker of the tree that this process was started with, once it has
    ended.

    arguments : of `python -m topdress.console.worker`. clock, wait : its time. An operator makes it
    ready and starts it; at `until_s` it is asked to end. options : of the host.
    """
    from topdress.console.worker.assemble import assemble_run
    from topdress.console.worker.loop_host import Host
    from topdress.console.worker.options import parse_options
    from topdress.console.worker.requests import ClientQuestion
    from topdress.control.orders import Do, Order

    parts = assemble_run(parse_options([*arguments, "--run-file", "none.json"]), clock)

    def sleep(seconds: float) -> None:
        wait(max(seconds, 1e-9))
        host.note_console_heard()
        state = host.newest_frame.row.state if host.newest_frame is not None else ""
        if clock() > 3.0 and state in ("off", "ready"):
            host.queue_request(
                Order(Do.READY if state == "off" else Do.START), lambda answer, _: None
            )
        if clock() > until_s:
            host.queue_request(ClientQuestion.QUIT, lambda answer, _: None)

    host = Host(parts, clock, sleep, **options)
    host.run_until_stopped()
    return host
