"""Runs the control worker as a program: `python -P -m topdress.console.worker`, see
`console.worker.program`.

The right to be the worker is taken before the modules are imported: a new lock needs 0.4 s to
settle, and the imports use this time.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence

from topdress.console import fast_imports

fast_imports.pause_gc_for_imports()

from topdress.console.worker import run_file  # noqa: E402
from topdress.console.worker.options import parse_options  # noqa: E402


def run_as_program(arguments: Sequence[str]) -> int:
    """Parse the options, take the right to be the worker, import the modules and run; return the
    exit code."""
    options = parse_options(arguments)
    with contextlib.ExitStack() as until_the_end:
        try:
            right = until_the_end.enter_context(run_file.hold_right(options.run_file))
        except OSError as error:
            print(f"topdress worker: {error}", file=sys.stderr, flush=True)
            return 1
        from topdress.console.worker.assemble import assemble_run
        from topdress.console.worker.program import run_with_right

        return run_with_right(options, assemble_run, right)


if __name__ == "__main__":
    sys.exit(run_as_program(sys.argv[1:]))
