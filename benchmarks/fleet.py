"""A fleet against the truth: what was planted (benchmarks/season/truth.py), what a season of logs says.

    python -m benchmarks fleet pooled [--seeds 11 12]    1,000 logs of 20 machines, each log as its quadratic form
    python -m benchmarks fleet logs DIR [--minutes 6]    makes the 1,000 logs in DIR (hidden generator), broken ones too
    python -m benchmarks fleet run DIR OUT [--workers 2] `topdress fleet` on them, then `reported`
    python -m benchmarks fleet reported OUT             truth against what stands in OUT
    python -m benchmarks fleet scaling DIR [--logs 60]   the first logs with 1 and 2 workers; share of overhead
    python -m benchmarks fleet killed DIR [--logs 40]    a worker killed, the command killed and started again
    python -m benchmarks fleet long DIR [--logs 20]      a log of 1e6 rows among others: memory of workers
    python -m benchmarks fleet elsewhere DIR [--logs 12] a scheduler and workers started by hand; logs by file:// and http://

Exit code 1 where a promise is not kept. `pooled` draws each log's form about the truth with the information of real
logs, so that a thousand logs cost seconds; all others diagnose real rows. Outputs lie next to DIR.
"""
from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "tests" / "diagnosis")]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from season import whole  # noqa: E402
from season.judged import Checks  # noqa: E402
from season.logs import make, make_broken  # noqa: E402
from season.pooled import pooled  # noqa: E402
from season.truth import days  # noqa: E402

from drivers.files.config import load  # noqa: E402
from drivers.files.kinds import MACHINE  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("pooled", "logs", "run", "reported", "scaling", "killed", "long", "elsewhere"))
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--minutes", type=float, default=6.0)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(11, 21)))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--logs", type=int, default=40)
    given = parser.parse_args()
    machine, checks = load("huanghai", MACHINE).model, Checks()
    if given.what == "pooled":
        checks = pooled(given.seeds, given.minutes, machine)
    elif given.folder is None:
        parser.error(f"{given.what} needs a folder")
    elif given.what == "logs":
        make(given.folder, days(), given.minutes, machine)
        make_broken(given.folder)
    elif given.what == "run":
        whole.run(given.folder, given.out or given.folder.with_name(f"{given.folder.name}-out"), given.workers, checks)
    elif given.what == "reported":
        whole.reported(given.folder, given.minutes, checks)
    elif given.what == "long":
        whole.long(given.folder, given.logs, machine, checks)
    else:
        {"scaling": whole.scaling, "killed": whole.killed, "elsewhere": whole.elsewhere}[given.what](
            given.folder, given.logs, checks)
    print(f"{len(checks.failed)} promises not kept")
    return 1 if checks.failed else 0


if __name__ == "__main__":
    sys.exit(main())
