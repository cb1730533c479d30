"""How is the first diagnosis on a computer made fast? `python -m console.warm_up` after installing
compiles in advance what that diagnosis would compile.

`make test` does so, and users of the extra diagnosis may. The machine model's steps are stored as
machine code in the user's cache folder (`control.machine.compiled`), Python's modules next to their
sources. The step is optional: missing code is compiled at its first use, which takes some seconds.
"""

from __future__ import annotations

import compileall
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from topdress.drivers.files.optional_packages import MissingExtra, require_extras

PACKAGE_FOLDER = Path(__file__).resolve().parents[1]
CONSOLE_COMMAND = (sys.executable, "-c", "from topdress.console.cli import main; main()")
# The short run contains an effect that begins in mid-run and a term, so that the diagnosis runs the
# searches for both.
PLANTED_OPTIONS = (
    "--effect",
    "flow.gain=8@60",
    "--term",
    "flow_percent bend speed_mps bend=-4.4 at=1.2",
)
# Shortest run for which `simulate` uses compiled steps, s.
SIMULATED_RUN_S = 600


def compile_packages() -> None:
    """Compiles all modules, and the machine model's steps by a short run and its diagnosis. Raises
    OSError on a full disk, CalledProcessError where a command fails."""
    for name in ("control", "drivers", "console"):
        compileall.compile_dir(str(PACKAGE_FOLDER / name), quiet=2)
    with tempfile.TemporaryDirectory(prefix="topdress-") as folder:
        log = str(Path(folder) / "log.csv")
        for words in (
            (
                "simulate",
                "--seconds",
                str(SIMULATED_RUN_S),
                "--seed",
                "1",
                *PLANTED_OPTIONS,
                "--out",
                log,
            ),
            ("diagnose", log),
        ):
            subprocess.run(
                [*CONSOLE_COMMAND, *words],
                check=True,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                cwd=folder,
            )


def run_warm_up() -> int:
    """Runs as a command and returns the exit code."""
    print("topdress: compiling the machine model for this computer, once: some 30 s", flush=True)
    started_s = time.monotonic()
    try:
        require_extras("a diagnosis", "diagnosis")
        compile_packages()
    except (MissingExtra, OSError, subprocess.SubprocessError) as error:
        said = (getattr(error, "stderr", None) or b"").decode(errors="replace").strip().splitlines()
        print(
            f"topdress: not compiled: {said[-1] if said else error}; the first diagnosis does it",
            file=sys.stderr,
        )
        return 1
    print(f"topdress: compiled in {time.monotonic() - started_s:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(run_warm_up())
