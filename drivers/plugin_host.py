"""How does the code of a plug-in run in its own process? The separate process prevents a plug-in
from ending, blocking or breaking the program; `drivers.plugin_process` starts it and sends
requests.

Requests come on standard input, answers go to standard output, one JSON object a line:

    {"do": "load"}                              {"gives": {"is_a": "HeadFields", "values": {...}}}
    {"do": "make"}                              {"gives": null}, a receiver's decoder is made
    {"do": "feed", "data": ..., "time_s": ...}  {"gives": {"fixes": [[...], ...], "counts": {...}}}
    {"do": "flush", "time_s": ...}              the same
    {"do": "read", "path": ...}                 {"gives": what the format's function returns}
    anything that raises                        {"raises": "ZeroDivisionError: division by zero"}
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import entry_points
from pathlib import Path
from queue import SimpleQueue
from typing import Any, BinaryIO

# Latin-1 maps each byte to one character, so JSON can hold any bytes.
JSON_BYTES_ENCODING = "latin-1"
# PR_SET_PDEATHSIG of prctl(2).
_LINUX_PARENT_DEATH_SIGNAL = 1
# Signal 9 cannot be caught by a hanging plug-in.
_KILL_SIGNAL = 9


class PluginHost:
    """Runs one plug-in, loaded on request."""

    def __init__(self, group: str, name: str) -> None:
        self._group, self._name = group, name
        self._loaded: Any = None
        self._decoder: Any = None
        self._does: dict[str, Callable[[dict[str, Any]], Any]] = {
            "load": self._load_plugin,
            "make": self._make_decoder,
            "feed": lambda asked: self._describe_fixes(
                self._decoder.feed(asked["data"].encode(JSON_BYTES_ENCODING), asked["time_s"])
            ),
            "flush": lambda asked: self._describe_fixes(self._decoder.flush(asked["time_s"])),
            "read": lambda asked: self._loaded(Path(asked["path"])),
        }

    def answer_request(self, request: bytes) -> bytes:
        """Returns the line that answers a request. Every exception of the plug-in becomes part of
        the answer."""
        try:
            asked = json.loads(request)
            given = {"gives": self._does[asked["do"]](asked)}
            return json.dumps(given, default=_convert_to_plain).encode() + b"\n"
        except BaseException as error:
            return json.dumps({"raises": _describe_error(error)}).encode() + b"\n"

    def _load_plugin(self, _asked: dict[str, Any]) -> dict[str, Any]:
        """Returns the type and values of the plug-in after loading it. Raises whatever its import
        raises."""
        found = entry_points(group=self._group, name=self._name)
        self._loaded = next(iter(found)).load()
        is_tuple = isinstance(self._loaded, tuple) and hasattr(self._loaded, "_asdict")
        kind = "callable" if callable(self._loaded) else type(self._loaded).__name__
        return {"is_a": kind, "values": self._loaded._asdict() if is_tuple else {}}

    def _make_decoder(self, _asked: dict[str, Any]) -> None:
        self._decoder = self._loaded()

    def _describe_fixes(self, fixes: Any) -> dict[str, Any]:
        counts = self._decoder.counts
        return {
            "fixes": [list(fix) for fix in fixes],
            "counts": {
                "read": counts.read,
                "accepted": counts.accepted,
                "rejected": dict(counts.rejected),
                "ignored": dict(counts.ignored),
            },
        }


def _convert_to_plain(value: Any) -> Any:
    """Returns numbers and arrays of numpy as plain numbers and lists. Raises TypeError for anything
    else."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"gives a {type(value).__name__}, which is no plain data")


def _describe_error(error: BaseException) -> str:
    """Returns the type and text of an error; the text of a ValueError is sufficient without its
    type."""
    text = ""
    with suppress(BaseException):
        text = str(error)
    kind = type(error).__name__
    return text if isinstance(error, ValueError) and text else f"{kind}: {text}".rstrip(": ")


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Reserves standard input and output for this program; the plug-in reads nothing, and its
    prints are dropped."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    return requests, answers


def _end_with_parent() -> None:
    """Makes the system end a hanging plug-in together with the calling program, where the system
    can do this."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            import ctypes

            ctypes.CDLL(None).prctl(_LINUX_PARENT_DEATH_SIGNAL, _KILL_SIGNAL)


def _queue_requests(requests: BinaryIO, queue: SimpleQueue[bytes]) -> None:
    """Queues requests, and ends this process after the last request, even if the plug-in hangs."""
    for line in requests:
        queue.put(line)
    os._exit(0)


def run_plugin_host(group: str, name: str) -> None:
    """Answers requests until the input ends."""
    requests, answers = _take_pipes()
    _end_with_parent()
    queue: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_queue_requests, args=(requests, queue), daemon=True).start()
    host = PluginHost(group, name)
    while True:
        answers.write(host.answer_request(queue.get()))
        answers.flush()
