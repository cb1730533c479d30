"""`topdress decode`: a raw capture through its real driver."""
from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer


def decode(protocol: Annotated[str, typer.Argument(metavar="PROTOCOL", help="gnss, greenseeker, board, ...")],
           file: Annotated[Path, typer.Argument(metavar="FILE", help="The capture, as received.")],
           as_json: Annotated[bool, typer.Option("--json", help="One JSON object a line.")] = False) -> None:
    """Read a raw capture of one device: a line for each accepted measurement, then the counts."""
    from drivers.devices.decode import decode as through_driver
    records, counts = through_driver(protocol, file.read_bytes())
    for record in records:
        known = {name: value for name, value in record.items() if value is not None}
        typer.echo(json.dumps(known) if as_json else "  ".join(f"{k}={_text(v)}" for k, v in known.items()))
    told: dict[str, Any] = {"read": counts.read, "accepted": counts.accepted, "rejected": dict(counts.rejected),
            "ignored": dict(counts.ignored)}
    if as_json:
        typer.echo(json.dumps({"counts": told}))
        return
    for word in ("rejected", "ignored"):
        kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(told[word].items()))
        told[word] = f"{sum(told[word].values())} ({kinds})" if kinds else 0
    typer.echo(", ".join(f"{word} {value}" for word, value in told.items()))


def _text(value: float | int | str) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
