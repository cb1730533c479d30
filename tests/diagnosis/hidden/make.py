"""Writes hidden-effect cases: python tests/diagnosis/hidden/make.py --cases 20 --programmes
tuning --out FOLDER"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from hidden.cases import CATEGORIES, cases
from hidden.classes import CLASSES
from hidden.write import write_all


def main() -> None:
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("--cases", type=int, default=20)
    a.add_argument("--seed", type=int, default=1)
    a.add_argument("--start", type=int, default=0, help="number of the first case")
    a.add_argument("--programmes", choices=("tuning", "unseen", "all"), default="tuning")
    a.add_argument(
        "--category",
        action="append",
        choices=(*CATEGORIES, *CLASSES),
        help="only these (repeatable)",
    )
    a.add_argument(
        "--kind", action="append", choices=("run", "lag", "catch", "weigh", "heads", "place")
    )
    a.add_argument("--id", action="append", help="only cases with this effect (repeatable)")
    a.add_argument("--out", type=Path, required=True)
    args = a.parse_args()
    try:
        made = cases(
            args.cases,
            args.seed,
            args.programmes,
            args.start,
            tuple(args.category or CATEGORIES),
            tuple(args.kind or ()),
            tuple(args.id or ()),
        )
        print(
            f"{write_all(made, args.out)} cases in {args.out / 'data'}, truth in "
            f"{args.out / 'truth'}"
        )
    except (ValueError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
