"""Machines that do what no catalogue holds: is it found, said rightly, and worth adopting?

    python -m benchmarks diagnosis/beyond --cases 300 --nulls 100 --seed 1 --programmes unseen \\
        --jobs 2 --minutes 60 \\
        --keep FOLDER [--out F.md]

Cases of the hidden generator (tests/diagnosis/hidden) in nine classes in turn, and healthy
logs. Each is diagnosed and adopted; then the same machine is driven again, with other canopy,
noise and drive, once on the same programme and once on another. There the machine file is held
against what the hidden term truly does, which only the generator knows. What is done is kept
below --keep and not done again as long as the code is the same. Exit code 1 where no case was
examined.
"""

from __future__ import annotations

import argparse
import sys
import time

from beyond_case import AGAIN, FIRST_NULL, Task, examine
from kept import HERE, ROOT, arguments, code_hash, worked, written

sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "diagnosis"), str(HERE)]

DECIDES = ("beyond_case.py", "beyond_other_run.py")  # and the program and the generator


def _numbers(args: argparse.Namespace) -> list[int]:
    """Cases and healthy logs, mixed, so that a run that is stopped has some of both."""
    cases = list(range(args.start, args.start + args.cases))
    nulls = list(range(FIRST_NULL + args.start, FIRST_NULL + args.start + args.nulls))
    whole = [((k + 0.5) / len(some), n) for some in (cases, nulls) for k, n in enumerate(some)]
    return [n for _, n in sorted(whole)]


def main() -> None:
    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--cases", type=int, default=300)
    a.add_argument("--nulls", type=int, default=100, help="healthy logs")
    arguments(a, "beyond", "tuning")
    args = a.parse_args()

    code = code_hash(HERE / name for name in DECIDES)
    name = f"{args.seed}-{args.programmes}-{code}"
    tasks = [Task(n, args.seed, args.programmes) for n in _numbers(args)]
    began = time.monotonic()
    kept, count = worked(tasks, examine, args.keep / f"{name}.jsonl", args.jobs, args.minutes)
    from beyond_report import nulls_table, of_kept, sections

    there = {n: one for n, one in sorted(kept.items()) if one["truth"] is not None}
    cases = {n: of_kept(one) for n, one in there.items() if n < FIRST_NULL}
    nulls = [one for n, one in there.items() if n >= FIRST_NULL]
    if not cases:
        sys.exit("no case was examined")
    busy = sum(one["whole_s"] for one in kept.values())
    asked = [(one["seconds"], one["processor_s"]) for one in there.values()]
    broken = sum(one["trouble"] is not None for one in kept.values())
    missing = {word: sum(kept[n][word] is None for n in cases) for word in AGAIN}
    lines = [
        f"# Beyond the catalogue: seed {args.seed}, programmes {args.programmes}",
        "",
        f"{len(cases)} of {args.cases} cases and {len(nulls)} of {args.nulls} healthy logs "
        f"examined; {broken} "
        "broke. In brackets: Wilson 95 % intervals. Shares: 1 - error left / removable "
        "error of the hidden term "
        "on another run of the same machine, truth without noise, all channels (a file that "
        "changes nothing: 0). "
        f"Cases without another run: {', '.join(f'{word} {n}' for word, n in missing.items())}.",
        "",
        *sections(list(cases.values())),
        "",
        "## Healthy logs",
        "",
        *nulls_table(nulls),
    ]
    lines += [
        "",
        f"Code {code}; {count} in this call, wall time "
        f"{(time.monotonic() - began) / 60:.1f} min with "
        f"{args.jobs} jobs; all {len(kept)} took {busy / 60:.1f} min of one job; a diagnosis "
        f"{sum(s for s, _ in asked) / max(1, len(asked)):.1f} s in the mean, of processor "
        f"{sum(s for _, s in asked) / max(1, len(asked)):.1f} s.",
    ]
    text = "\n".join(lines) + "\n"
    written(text, args.out)
    print(f"\n{len(cases)} cases", file=sys.stderr)


if __name__ == "__main__":
    main()
