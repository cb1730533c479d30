"""Writes cases with their truth for training: CSV and Parquet, with a data card.

python benchmarks/examination/export.py --cases 100 --seed 1 --out examination-training
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [
    str(Path(__file__).resolve().parent),
    str(ROOT),
    str(ROOT / "tests" / "diagnosis"),
]

CARD = """---
license: apache-2.0
task_categories: [time-series-forecasting, tabular-classification]
---
# Examination of diagnoses: training cases

{cases} cases of seed {seed}, drive programmes of the half `{programmes}`, written by
`benchmarks/examination/export.py` of topdress. All are simulated: by `tests/diagnosis/hidden` (a
variable-rate applicator: runs and bench tables) and by `benchmarks/examination/drives.py` (motors
with an encoder). No recording of a machine, person or place is in them.

| file | what |
|---|---|
| `cases/NAME/log.csv`, `bench.csv`, `.parquet` | what an entry gets; an empty cell is no value |
| `cases/NAME/kind.txt`, `machine.yaml` | kind of data; the machine as it should be |
| `truth/NAME/truth.json` | ids, sizes and z, or `none`, `unknown`; `alike`: ids of the same trace |
| `truth/NAME/other.csv` | another run of the same machine |
| `truth.parquet` | a row a case: name, kind, category, ids, none, unknown |

{counts}

Not for scoring: an examination makes its own cases by a seed given then. Noise, forms and what is
assumed: `tests/diagnosis/hidden/README.md`.
"""


def write_parquet(path: Path) -> None:
    """Writes a CSV file as Parquet next to it."""
    import polars

    # The first rows of an event column are empty; all rows decide its type.
    polars.read_csv(path, infer_schema_length=None).write_parquet(path.with_suffix(".parquet"))


def main() -> int:
    """Writes the folder."""
    import polars
    from cases import write_case

    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--cases", type=int, default=100)
    a.add_argument("--seed", type=int, default=1)
    a.add_argument("--programmes", choices=("tuning", "unseen"), default="tuning")
    a.add_argument("--out", type=Path, required=True)
    args = a.parse_args()
    rows = []
    for number in range(args.cases):
        case = write_case(number, args.seed, args.out, args.programmes)
        for path in sorted([*case.folder.glob("*.csv"), *case.truth.glob("*.csv")]):
            write_parquet(path)
        truth = json.loads((case.truth / "truth.json").read_text(encoding="utf-8"))
        rows.append(
            {
                "name": case.folder.name,
                "kind": (case.folder / "kind.txt").read_text(encoding="utf-8"),
                "turn": truth["turn"],
                "category": truth["category"],
                "ids": truth["ids"],
                "none": truth["none"],
                "unknown": truth["unknown"],
            }
        )
    table = polars.DataFrame(rows, schema_overrides={"ids": polars.List(polars.String)})
    table.write_parquet(args.out / "truth.parquet")
    counts = table.group_by("turn", "category").len().sort("turn", "category")
    lines = ["| cases of | category | count |", "|---|---|---|"]
    lines += [f"| {turn} | {category} | {count} |" for turn, category, count in counts.iter_rows()]
    card = CARD.format(
        cases=args.cases, seed=args.seed, programmes=args.programmes, counts="\n".join(lines)
    )
    (args.out / "README.md").write_text(card, encoding="utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
