"""Every number of a machine file and of a job file at both ends of its range: `python -m benchmarks extremes_of_files`

Each is put into the shipped file in turn, read as any file is read, and the machine is simulated for some seconds with
at most 2 GB of memory. Printed: what was refused for another number's sake, what took long, and what broke.
"""
from __future__ import annotations

import argparse
import datetime as dt
import resource
import sys
import time
from collections.abc import Iterator
from typing import Any

from verdict import exit_code

from control.agronomy.crop import Crop
from control.field.job import Job, rule_of
from control.machine.machine import Machine
from control.orders import Do, Order
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.closed_loop import simulated_run
from drivers.files.config import ConfigError, Kind, validated
from drivers.files.kinds import CROP, JOB, MACHINE
from drivers.files.plain import plain, schema_of
from drivers.files.setup import load_setup

MEMORY_BYTES = 2 * 1024 ** 3
SECONDS = 6.0
SLOW_S = 20.0

Path = tuple[str | int, ...]
Numbers = Iterator[tuple[Path, float, float]]


def numbers(node: dict[str, Any], defs: dict[str, Any], at: Path = ()) -> Numbers:
    """Every number of a schema that a file may hold, with its lowest and highest value; of lists and tables none."""
    if "$ref" in node:
        node = defs[node["$ref"].rsplit("/", 1)[-1]]
    for other in node.get("anyOf", []):
        yield from numbers(other, defs, at)
    if node.get("type") in ("number", "integer"):
        step = 1 if node["type"] == "integer" else 1e-9
        low = node["minimum"] if "minimum" in node else node["exclusiveMinimum"] + step
        high = node["maximum"] if "maximum" in node else node["exclusiveMaximum"] - step
        yield at, low, high
    for name, child in node.get("properties", {}).items():
        yield from numbers(child, defs, (*at, name))


def put(data: Any, at: Path, value: float) -> Any:
    """The data with one value put in; parts on the way that are missing are made."""
    if not at:
        return value
    return dict(data or {}) | {at[0]: put((data or {}).get(at[0]), at[1:], value)}


def tried(machine: Machine, job: Job, crop: Crop) -> None:
    rule = rule_of(crop, job, 110)
    job = with_simulated_field(job, machine)
    plant = simulated_machine(machine, job, 1, 0.05)
    loop = control_loop(machine, crop, rule, job)
    for step in simulated_run(plant, loop, SECONDS, [(0.5, Order(Do.READY)), (1.0, Order(Do.START))]):
        assert step.tick.row is not None


def main(only: str = "") -> int:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    setup = load_setup("huanghai", "demo", dt.date(2026, 4, 1))
    parts: dict[str, tuple[Kind[Any], Any]] = {
        "machine": (MACHINE, setup.machine), "job": (JOB, setup.job), "crop": (CROP, setup.crop)}
    count, refused, broken = 0, 0, list[str]()
    for name, (kind, model) in parts.items():
        data, schema = plain(model), schema_of(kind.model)
        for at, *ends in numbers(schema, schema.get("$defs", {})):
            for value in ends:
                what = f"{name}: {'.'.join(map(str, at))} {value:g}"
                if only not in what:
                    continue
                count += 1
                began_s = time.process_time()
                try:
                    changed = validated(put(data, at, value), kind, name)
                    tried(**({key: one for key, (_, one) in parts.items()} | {name: changed}))
                except (ConfigError, ValueError) as error:
                    refused += 1
                    print(f"refused  {what}: {str(error).splitlines()[0][:150]}", flush=True)
                except Exception as error:
                    broken.append(what)
                    print(f"BROKEN   {what}: {type(error).__name__}: {error}", flush=True)
                took_s = time.process_time() - began_s
                if took_s > SLOW_S:
                    broken.append(what)
                    print(f"SLOW     {what}: {took_s:.0f} s", flush=True)
    print(f"{count} files, {refused} refused in one line, {len(broken)} broken or slow; most memory "
          f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0:.0f} MB")
    return exit_code({f"{count} files: above 0": count > 0, f"broken or slow: {broken}": not broken})


if __name__ == "__main__":
    given = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    given.add_argument("--only", default="", help="part of KIND: KEY")
    sys.exit(main(given.parse_args().only))
