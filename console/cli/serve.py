"""How does `topdress serve` show the console in a browser, for a tablet in the cab or a screen in
the office?
"""

from __future__ import annotations

import ipaddress
import os
import secrets
import sys
from pathlib import Path
from typing import Annotated

import typer
from topdress.console.cli.plain_errors import CommandError
from topdress.drivers.files.optional_packages import require_extras

# The alphabet excludes letters that resemble each other.
TOKEN_ALPHABET = "abcdefghjkmnpqrstuvwxyz23456789"
# Ten letters of this alphabet have 49 bits.
TOKEN_LETTERS = 10
MIN_TOKEN_LETTERS = 6


def serve_tablets(
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Address to listen on; 0.0.0.0 for a tablet on the same network.",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(metavar="PORT", min=1, max=65535, help="Port to listen on.")
    ] = 8000,
    token_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Its first line is the key that lets a tab "
            "operate the machine; made where it does not exist. Without it: "
            "tabs only look.",
        ),
    ] = None,
) -> None:
    """Serve the console to browsers. A tab attaches to the control worker that runs; it never
    starts one."""
    require_extras("serve", "serve")
    from topdress.console.running import find_running_worker
    from topdress.console.serve.server import TabletServer

    command = [sys.executable, "-P", "-m", "topdress.console.cli.tablet"]
    if token_file is not None:
        made = prepare_token(token_file)
        typer.echo(f"key          {'made: ' if made else ''}{token_file}")
        command += ["--token-file", str(token_file.resolve())]
    else:
        typer.echo("key          none: tabs only look")
    running = find_running_worker()
    typer.echo(
        "worker       "
        f"{f'process {running.pid}' if running else 'none runs: tabs say so until one does'}"
    )
    typer.echo(
        f"console      http://{'[' + host + ']' if ':' in host else host}:{port}  (Ctrl-C ends)"
    )
    if not _is_loopback(host):
        typer.echo(
            "note         everybody in this network can look; what is typed, the key too, "
            "goes over it as it is"
        )
    TabletServer(command, host, port).serve()


def prepare_token(path: Path) -> bool:
    """Checks the token file, or creates one that only its owner can read; returns True for a new
    file.

    Raises CommandError for a file without a key, or with a key that is too short.
    """
    if path.exists():
        lines = path.read_text(encoding="utf-8").strip().splitlines()
        if not lines or len(lines[0].strip()) < MIN_TOKEN_LETTERS:
            raise CommandError(
                f"{path}: its first line is no key: at least {MIN_TOKEN_LETTERS} letters or digits"
            )
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with open(handle, "w", encoding="utf-8") as file:
        file.write(
            "".join(secrets.choice(TOKEN_ALPHABET) for _letter in range(TOKEN_LETTERS)) + "\n"
        )
    return True


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
