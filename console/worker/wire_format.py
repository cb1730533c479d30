"""Converts frames, answers and the greeting to bytes, one JSON object per line."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

from topdress.console.frame import Frame, format_frame_json
from topdress.console.worker_handshake import WORKER_GREETING
from topdress.control.orders import Answer


def format_greeting(pid: int) -> bytes:
    """Return the first line to every client. It identifies the worker, so that a port taken over by
    another program is recognised."""
    return _format_json_line({"hello": WORKER_GREETING, "pid": pid})


def format_answer(number: int | None, answer: Answer, extra: dict[str, Any]) -> bytes:
    """Return the answer to a request as a line."""
    return _format_json_line(
        {"answer": number, "accepted": answer.accepted, "why": answer.why} | extra
    )


def format_frame(frame: Frame) -> bytes:
    """Return a frame as a line. A value that is not finite is sent as unknown, so that it never
    blinds the console.

    Raises ValueError if anything except the row is not finite.
    """
    try:
        return format_frame_json(frame)
    except ValueError:
        unknown: dict[str, Any] = {
            name: None
            for name, value in frame.row._asdict().items()
            if isinstance(value, float) and not math.isfinite(value)
        }
        return format_frame_json(replace(frame, row=frame.row._replace(**unknown)))


def _format_json_line(message: dict[str, Any]) -> bytes:
    """Return a message as a line of JSON."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode() + b"\n"
