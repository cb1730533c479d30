"""How does `topdress calibrate lag --rig URL` work without a board? The machine's own drive turns
the shaft, and the rig measures the drop time.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import typer
from topdress.console.cli.plain_errors import CommandError

TICK_PERIOD_S = 0.02
DEVICE_TIMEOUT_S = 10.0
PHASE_WORDS = {
    "stop": "stop the shaft and wait",
    "arming": "the rig is made ready",
    "start": "START the shaft",
    "falling": "wait for the granules",
}


def measure_drop(rig: str, out: Path, runs: int) -> None:
    """Measures `runs` runs and writes `out`; after an interruption the measured runs stay in the
    file. Raises CommandError."""
    from topdress.drivers.cab import Cab
    from topdress.drivers.cab_config import CabConfig
    from topdress.drivers.devices.lag_run import DropProcedure, make_drop_table
    from topdress.drivers.files.atomic_files import write_atomically

    cab = Cab(CabConfig.model_validate({"lag_rig": {"port": rig}}), time.monotonic)
    test, started_s, phase, kept = DropProcedure(), time.monotonic(), "", 0
    typer.echo("no board: this program turns nothing; only drop times are measured (Ctrl-C ends)")
    try:
        while len(test.runs) < runs:
            now_s = time.monotonic()
            cab.read_measurements(now_s)
            if cab.rig_readings is None and now_s - started_s > DEVICE_TIMEOUT_S:
                state = cab.list_device_status(now_s)[0]
                raise CommandError(
                    f"lag test: lag_rig at {rig} is silent: {state.last_error or 'no byte'}"
                )
            wish = test.run_tick(now_s, cab.rig_readings)
            cab.send_rig_order(wish.run, wish.arm)
            if wish.failure:
                typer.echo(f"failed: {wish.failure}")
            if len(test.runs) > kept:
                kept = len(test.runs)
                write_atomically(out, make_drop_table(test.runs))
                typer.echo(
                    f"{kept} of {runs}: {test.runs[-1].shaft_rpm:.1f} r/min, "
                    f"{test.runs[-1].drop_s:.3f} s"
                )
            if cab.rig_readings is not None and wish.phase != phase:
                phase = wish.phase
                sys.stderr.write(f"{PHASE_WORDS[phase]}\n")
            time.sleep(TICK_PERIOD_S)
    finally:
        cab.send_rig_order(0, False)
        cab.close_devices()
        if kept:
            typer.echo(f"{kept} of {runs} runs: {out}")
