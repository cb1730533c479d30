"""`python -P -m topdress.console.worker`: see `console.worker.program`.

The right to be the worker is taken before the modules are read: a lock that is new has to
settle for 0.4 s, in which they come up.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence

from topdress.console import import_hooks

import_hooks.begin()

from topdress.console.worker import run_file  # noqa: E402
from topdress.console.worker.options import parse_options  # noqa: E402


def main(arguments: Sequence[str]) -> int:
    options = parse_options(arguments)
    with contextlib.ExitStack() as until_the_end:
        try:
            right = until_the_end.enter_context(run_file.held(options.run_file))
        except OSError as error:
            print(f"topdress worker: {error}", file=sys.stderr, flush=True)
            return 1
        from topdress.console.worker.assemble import assemble
        from topdress.console.worker.program import run

        return run(options, assemble, right)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
