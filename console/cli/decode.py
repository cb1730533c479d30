"""How does `topdress decode` read a raw capture through its real driver?"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from topdress.console.cli.inputs import CAPTURE_KINDS, refuse_other_kinds
from topdress.console.cli.plain_errors import CommandError


def decode_capture(
    protocol: Annotated[
        str, typer.Argument(metavar="PROTOCOL", help="gnss, greenseeker, board, ...")
    ],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The capture, as received.")],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a line.")] = False,
) -> None:
    """Read a raw capture of one device: a line for each accepted measurement, then the counts."""
    from topdress.drivers.devices.decode import decode_capture as through_driver

    refuse_other_kinds([file], CAPTURE_KINDS)
    records, counts = through_driver(protocol, file.read_bytes())
    for record in records:
        known = {name: value for name, value in record.items() if value is not None}
        typer.echo(
            json.dumps(known)
            if as_json
            else "  ".join(f"{k}={_format_value(v)}" for k, v in known.items())
        )
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "counts": {
                        "read": counts.read,
                        "accepted": counts.accepted,
                        "rejected": dict(counts.rejected),
                        "ignored": dict(counts.ignored),
                    }
                }
            )
        )
    else:
        typer.echo(
            f"read {counts.read}, accepted {counts.accepted}, rejected "
            f"{_format_counts(counts.rejected)}, "
            f"ignored {_format_counts(counts.ignored)}"
        )
    of_the_device = {kind for kind in counts.ignored if kind not in ("comment", "partial_first")}
    if not counts.accepted and not of_the_device:
        raise CommandError(
            f"{file}: no measurement of {protocol} in {file.stat().st_size} bytes: allowed is the "
            "capture of such a device, as received"
        )


def _format_counts(counted: Mapping[str, int]) -> str:
    kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(counted.items()))
    return f"{sum(counted.values())} ({kinds})" if kinds else "0"


def _format_value(value: float | int | str) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
