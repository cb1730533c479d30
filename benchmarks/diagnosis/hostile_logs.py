"""Hostile logs through `topdress diagnose`: exit codes, seconds of processor, faults; a line a log and a sum.

    python -m benchmarks diagnosis/hostile_logs [--logs 60] [--seed 1] [--start 0] [--only WORD] [--keep FOLDER]

The logs are those of tests/diagnosis/hostile: plain machines whose recordings were spoilt in one to three ways. A
fault is an exit code other than 0, 2 (only where the file may be refused, and then one line) and 3, a line that no
user should read, a result that is no JSON, or a log that takes longer than `LONGEST_S`. Ends with code 1 where there
was one. POSIX only.
"""
from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "diagnosis")]

TOPDRESS = (sys.executable, "-c", "from console.cli import main; main()")
LONGEST_S = 60.0            # of processor, of a log
MOST_BYTES = 8 << 30        # of memory that a log may ask for: more is a fault, not the end of the computer
# Words of a line for a user that speak of our own trouble, not of the file.
OURS = ("Warning", "Traceback", "fault of topdress", "please report", "validation error", "must not contain",
        "Input should", "array", "broadcast", "singular", "nan ", "dtype", "NoneType")


def tried(text: str, folder: Path) -> tuple[int, float, str, str]:
    """Exit code, seconds, what was said on the error stream, verdict or what is wrong with the result."""
    log, out = folder / "log.csv", folder / "out.json"
    log.write_text(text, encoding="utf-8", newline="\n")
    out.unlink(missing_ok=True)
    begin = _used_s()
    done = subprocess.run([*TOPDRESS, "diagnose", str(log), "--json", str(out)], cwd=ROOT,
                          capture_output=True, text=True, check=False, preexec_fn=_bounded,
                          env={**os.environ, "PYTHONWARNINGS": "default", "OMP_NUM_THREADS": "1"})
    took_s = _used_s() - begin
    said = done.stderr.replace(str(log), "log.csv")
    try:
        result = json.loads(out.read_text(), parse_constant=_no_number) if out.exists() else {}
        found = result.get("verdict", "")
        said += "".join(f"\nleft out: {text}" for text in result.get("findings", ()) if "please report" in text)
    except ValueError as error:
        found = f"no JSON: {error}"
    return done.returncode, took_s, said, found


def _used_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _bounded() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (600, 600))


def _no_number(text: str) -> Any:
    raise ValueError(f"{text} is no number of JSON")


def faults(code: int, took_s: float, said: str, found: str, refusable: bool) -> list[str]:
    wrong = [f"a line with {word!r}" for word in OURS if word in said]
    if code == 2 and not refusable:
        wrong.append("refused, though it can be read")
    if code not in (0, 2, 3):
        wrong.append(f"exit code {code}")
    if code != 2 and (not found or found.startswith("no JSON")):
        wrong.append(found or "no result")
    if took_s > LONGEST_S:
        wrong.append(f"{took_s:.0f} s")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--logs", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--only", default="", help="of the logs' names")
    parser.add_argument("--keep", type=Path, help="folder for the logs that made a fault")
    args = parser.parse_args()
    from hostile.logs import hostile_log
    codes: Counter[int] = Counter()
    wrong_logs, seconds = 0, []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(args.start, args.start + args.logs):
            one = hostile_log(number, args.seed)
            if args.only not in one.name:
                continue
            code, took_s, said, found = tried(one.text, Path(folder))
            wrong = faults(code, took_s, said, found, one.refusable)
            codes[code] += 1
            seconds.append(took_s)
            wrong_logs += bool(wrong)
            print(f"{one.name}: exit {code}, {took_s:.1f} s, {found or 'no result'}"
                  f"{'; FAULT: ' + ', '.join(wrong) if wrong else ''}", flush=True)
            if wrong or code == 2:
                print(f"    {said.strip().splitlines()[-1] if said.strip() else ''}"[:300], flush=True)
            if wrong and args.keep is not None:
                args.keep.mkdir(parents=True, exist_ok=True)
                (args.keep / f"{number:03d}.csv").write_text(one.text, encoding="utf-8", newline="\n")
    shown = ", ".join(f"exit {code}: {count}" for code, count in sorted(codes.items()))
    seconds.sort()
    print(f"{len(seconds)} logs of seed {args.seed}: {shown}; median {seconds[len(seconds) // 2]:.1f} s, longest "
          f"{seconds[-1]:.1f} s; {wrong_logs} with faults")
    return 1 if wrong_logs else 0


if __name__ == "__main__":
    sys.exit(main())
