"""`python -P -m console.worker`: see `console.worker.program`."""
from __future__ import annotations

import sys

from console import quick_start

quick_start.begin()

from console.worker.assemble import assemble  # noqa: E402
from console.worker.program import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], assemble))
