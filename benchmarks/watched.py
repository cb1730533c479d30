"""`topdress watch` on six logs of other programs that grow at 20 Hz: processor, delay, a damaged line, an end.

    python benchmarks/watched.py RUN.csv [--onset 600] [--tree OLD]

RUN.csv: a run log at 20 Hz in which something begins at the onset (`topdress simulate --effect shaft.gain=-5@600`). It
is written anew in six dialects, 5 s of it between two looks at the file, as a clock would bring them. Processor is that
of this process within the looks, over the time of the log. At 400 s a damaged line stands in each.
"""
from __future__ import annotations

import argparse
import inspect
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

STEP_S, DAMAGED_S = 5.0, 400.0
DAMAGED = b"\x00\x00\x01;,;\"#\n"
COLUMNS = {"speed_mps": ("speed", "m/s"), "wheel_speed_mps": ("wheel speed", "m/s"),
           "shaft_rpm_cmd": ("shaft set", "r/min"), "shaft_rpm": ("shaft is", "r/min"),
           "opening_mm_cmd": ("opening set", "mm"), "opening_mm": ("opening is", "mm"),
           "hopper_kg": ("hopper", "kg"), "supply_v": ("supply", "V")}
DIALECTS = {"semicolons, decimal commas": (";", ",", "utf-8", "unix_ms"), "commas": (",", ".", "utf-8", "unix_s"),
            "tabs": ("\t", ".", "utf-8", "ms"), "bars": ("|", ".", "utf-8", "s"),
            "GBK": (",", ".", "gbk", "unix_ms"), "Windows-1252": (";", ",", "cp1252", "s")}


def lines_of(run: Path, delimiter: str, decimal: str, encoding: str, clock: str) -> tuple[bytes, list[bytes], str]:
    """Header, a line a row, and the import file."""
    frame = pl.read_csv(run, infer_schema_length=None)
    head = delimiter.join(["clock", *(name for name, _ in COLUMNS.values())]) + "\n"
    scale, begin = (1000.0 if clock.endswith("ms") else 1.0), (1.77e9 if clock.startswith("unix") else 0.0)
    table = [[f"{(begin + one) * scale:.{0 if scale > 1 else 3}f}" for one in frame["time_s"]]]
    table += [[f"{one:.4f}" if one is not None else "" for one in frame[name].cast(pl.Float64)] for name in COLUMNS]
    rows = [(delimiter.join(cells).replace(".", decimal) + "\n").encode(encoding) for cells in zip(*table, strict=True)]
    said = f"format: topdress-import/1\ntime: {{column: clock, counts: {clock}}}\ncolumns:\n" + "".join(
        f"  {ours}: {{from: {name}, unit: {unit}}}\n" for ours, (name, unit) in COLUMNS.items())
    return head.encode(encoding), rows, said


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path)
    parser.add_argument("--onset", type=float, default=600.0)
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[1])
    parser.add_argument("--only", type=int, default=len(DIALECTS))
    given = parser.parse_args()
    sys.path.insert(0, str(given.tree))
    for name, dialect in list(DIALECTS.items())[:given.only]:
        with TemporaryDirectory(prefix="topdress-") as folder:
            watched(name, Path(folder) / "other.csv", *lines_of(given.run, *dialect), given.onset)
    return 0


def watched(name: str, path: Path, head: bytes, rows: list[bytes], said: str, onset_s: float) -> None:
    from console.services.live_check import followed
    path.write_bytes(head + b"".join(rows[:100]))
    path.with_name("import.yaml").write_text(said)
    path.with_suffix(".import.yaml").write_text(said)
    per_step, used, at, lines = int(STEP_S * 20), [0.0], [100], list[str]()
    began = [time.process_time()]

    def wait() -> bool:
        used[0] += time.process_time() - began[0]
        begin, end = at[0], at[0] + per_step
        at[0] = end
        with path.open("ab") as file:
            file.write(b"".join(rows[begin:end]))
            if begin <= DAMAGED_S * 20 < end:
                file.write(DAMAGED)
        began[0] = time.process_time()
        return begin < len(rows) + 20 * per_step
    more: list[Callable[[str], None]] = [lines.append] if "tell" in inspect.signature(followed).parameters else []
    found: list[tuple[float, str]] = []
    try:
        for look in followed(path, "huanghai", wait, *more):
            if look.departure is not None and not found:
                found.append((look.at_s, f"{look.departure.channel} {look.departure.cause or 'no name'}"))
    except Exception as error:
        lines.append(f"ended at {at[0] / 20:.0f} s: {type(error).__name__}: {str(error).splitlines()[0][:90]}")
    log_s = min(at[0], len(rows)) / 20.0
    delay = f"{(found[0][0] - onset_s) / 60.0:.1f} minutes after the onset: {found[0][1]}" if found else "nothing said"
    print(f"{name}: {100.0 * used[0] / max(log_s, 1.0):.1f} % of a core over {log_s:.0f} s of the log; {delay}; "
          f"{[one.split(': ', 1)[-1] for one in lines]}", flush=True)


if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(main())
