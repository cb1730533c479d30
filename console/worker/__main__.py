"""`python -P -m console.worker`: see `console.worker.program`."""
from __future__ import annotations

import sys

from console.worker.assemble import assemble
from console.worker.program import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], assemble))
