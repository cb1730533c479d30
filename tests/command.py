"""The command as a user calls it."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

from click.testing import Result
from topdress.console.cli import app
from typer.testing import CliRunner

# as a process of its own
TOPDRESS = [sys.executable, "-c", "from topdress.console.cli import main; main()"]


def topdress(*words: object, **given: Any) -> Result:
    """Runs the command with these arguments. given: `input`, `env`."""
    return CliRunner().invoke(app, [str(word) for word in words], **given)


@contextlib.contextmanager
def serving(*options: str, before: str = "") -> Iterator[dict[str, list[str]]]:
    """`topdress serve-machine` on free ports: device -> URLs. `before`: what its process does
    first."""
    child = subprocess.Popen(
        [*TOPDRESS[:2], before + TOPDRESS[2], "serve-machine", "--port", "0", *options],
        stdout=subprocess.PIPE,
        text=True,
    )
    urls: dict[str, list[str]] = {}
    try:
        for line in child.stdout:
            if line.startswith("serving"):
                break
            device, _, url = line.split()
            urls.setdefault(device, []).append(url)
        yield urls
    finally:
        child.terminate()
        child.communicate(timeout=10)
