"""The machine model over a run log, interpreted and compiled from one source: are they equal, and how fast is a step?

    topdress simulate --seconds 3600 --out hour.csv
    python benchmarks/prediction.py hour.csv
"""
from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from verdict import exit_code

from control.machine.flow import Flow, FlowInput, FlowOutput, flow_start, flow_step
from control.machine.gate import Gate, GateInput, GateOutput, gate_start, gate_step
from control.machine.over_log import LEAST_STEPS, MOST_STEP_S, input_rows, no_switch, over_log
from control.machine.shaft import Shaft, ShaftInput, ShaftOutput, shaft_start, shaft_step
from drivers.files.read_log import read_log

REPEATS = 5


def main(path: str) -> int:
    log = read_log(path)
    known = ~np.isnan(log.numbers("shaft_rpm")) & ~np.isnan(log.numbers("opening_mm"))
    begin = int(np.argmax(known))
    time_s = log.time_s[begin:]
    column = {name: log.numbers(name)[begin:] for name in ("shaft_rpm_cmd", "opening_mm_cmd", "shaft_rpm", "opening_mm",
                                                           "supply_v", "hopper_kg", "pitch_deg")}
    column = {name: np.nan_to_num(values) for name, values in column.items()}
    n = len(time_s)
    begun = time.perf_counter()
    from control.machine import compiled
    print(f"{path}: {n} rows, {time_s[-1] - time_s[0]:.0f} s; numba loaded in {time.perf_counter() - begun:.2f} s")
    shaft0, gate0, hopper0 = column["shaft_rpm"][0], column["opening_mm_cmd"][0], column["hopper_kg"][0]
    stages: list[tuple[str, Any, Any, Any, Any, Any, Any]] = [
        ("shaft", shaft_step, compiled.shaft_run, Shaft(), shaft_start(0.0, time_s[0]), ShaftOutput(shaft0, shaft0),
         input_rows(ShaftInput, n, command_rpm=column["shaft_rpm_cmd"], opening_mm=column["opening_mm"],
                    supply_v=column["supply_v"])),
        ("gate", gate_step, compiled.gate_run, Gate(), gate_start(gate0, time_s[0]), GateOutput(gate0, gate0),
         input_rows(GateInput, n, command_mm=column["opening_mm_cmd"])),
        ("flow", flow_step, compiled.flow_run, Flow(), flow_start(hopper0, time_s[0]), FlowOutput(0.0, hopper0),
         input_rows(FlowInput, n, shaft_rpm=np.maximum(0.0, column["shaft_rpm"]), opening_mm=column["opening_mm"],
                    pitch_deg=column["pitch_deg"]))]
    promises: dict[str, object] = {f"{n} rows with shaft and gate: at least 2": n > 1, "the shaft turns": column[
        "shaft_rpm"].max(initial=0.0) > 0.0}
    for name, step, run, params, state, first, rows in stages:
        arguments = ((params,), no_switch(), state, first, rows, time_s, MOST_STEP_S)
        begun = time.perf_counter()
        interpreted = over_log(step)(*_fresh(arguments))
        slow = time.perf_counter() - begun
        run(*_fresh(arguments))
        times = []
        for _ in range(REPEATS):
            again = _fresh(arguments)
            begun = time.perf_counter()
            fast_out = run(*again)
            times.append(time.perf_counter() - begun)
        fast = sorted(times)[REPEATS // 2]
        steps = (n - 1) * LEAST_STEPS
        equal = np.array_equal(interpreted, fast_out)
        promises[f"{name}: interpreted and compiled are equal to the bit"] = equal
        print(f"{name:6s} interpreted {1e9 * slow / steps:8.0f} ns/step, compiled {1e9 * fast / steps:6.1f} ns/step, "
              f"ratio {slow / fast:5.0f}, equal to the bit: {equal}, largest difference "
              f"{np.abs(interpreted - fast_out).max():g}")
    return exit_code(promises)


def _fresh(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """The same arguments with the delay line's arrays copied: a run writes in them."""
    sets, switch, state, *rest = arguments
    if hasattr(state, "line"):
        line = state.line
        state = state._replace(line=line._replace(times_s=line.times_s.copy(), values=line.values.copy()))
    return (sets, switch, state, *rest)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python benchmarks/prediction.py RUN_LOG.csv")
    sys.exit(main(sys.argv[1]))
