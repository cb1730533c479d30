"""Sentences a second through the whole GNSS path (bytes to fixes) against bare `pynmea2.parse`, in one run.

    python -m benchmarks gnss_throughput [RECORDING...]

Without recordings: 10 Hz epochs of GGA, RMC and VTG, made here. Processor time, best of five; both are given the same
sentences, pynmea2 already cut into lines of text.
"""
from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import pynmea2
from verdict import exit_code

from control.readings import GnssFix
from drivers.devices.gnss import GnssDecoder
from drivers.virtual.encoders import gnss_sentences

EPOCHS = 5000


def made() -> bytes:
    return b"".join(gnss_sentences(GnssFix(0.0, 34.28 + n * 1e-7, 119.88, 4, 14, 0.8, 1.25, 12.0,
                                           f"2026-04-01T06:{n // 600:02d}:{n // 10 % 60:02d}.{n % 10}00Z"))
                    for n in range(EPOCHS))


def best(work: Callable[[], object]) -> float:
    took = []
    for _ in range(5):
        before_s = time.process_time()
        work()
        took.append(time.process_time() - before_s)
    return min(took)


def compare(name: str, data: bytes) -> int:
    """Prints a row; how many sentences were accepted."""
    lines = [line.decode("ascii", "replace") for line in data.splitlines() if line.startswith(b"$")]

    def bare() -> None:
        for line in lines:
            try:
                pynmea2.parse(line, check=True)
            except pynmea2.ParseError:
                continue

    def whole() -> GnssDecoder:
        decoder = GnssDecoder()
        for at in range(0, len(data), 64):
            decoder.feed(data[at:at + 64], at / 960.0)
        return decoder

    counts = whole().counts
    if not lines:
        return 0
    bare_s, whole_s = best(bare), best(whole)
    print(f"| {name} | {len(lines)} | {counts.accepted} | {len(lines) / bare_s:.0f} | {len(lines) / whole_s:.0f} | "
          f"{whole_s / bare_s:.2f} |")
    return counts.accepted


def main(recordings: list[str]) -> int:
    print("| sentences of | number | accepted | bare pynmea2, a second | GNSS path, a second | time over bare |")
    print("|---|---|---|---|---|---|")
    if not recordings:
        return exit_code({"every sentence that was made is accepted": compare("10 Hz receiver", made()) == 3 * EPOCHS})
    return exit_code({f"{file}: some sentences are accepted": compare(Path(file).name, Path(file).read_bytes())
                      for file in recordings})


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
