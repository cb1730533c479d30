"""Interpreted and compiled run the same source: equal to the bit; the step is small enough;
rows line up with time."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.control.machine import compiled
from topdress.control.machine.fall import calc_drop_s, find_start_drop_s
from topdress.control.machine.flow import Flow, FlowInput, FlowOutput, make_flow_start, step_flow
from topdress.control.machine.gate import Gate, GateInput, GateOutput, make_gate_start, step_gate
from topdress.control.machine.jit_cache import CompiledCodeCache, rename_uniquely
from topdress.control.machine.landing import calc_carried_s, calc_fall_times_s
from topdress.control.machine.machine import Machine, list_effect_sizes
from topdress.control.machine.parameter_uncertainty import (
    PLAUSIBLE_MACHINES,
    make_plausible_machine,
)
from topdress.control.machine.shaft import (
    Shaft,
    ShaftInput,
    ShaftOutput,
    make_shaft_start,
    step_shaft,
)
from topdress.control.machine.speed import (
    Speed,
    SpeedInput,
    SpeedOutput,
    make_speed_start,
    step_speed,
)
from topdress.control.machine.stage_runner import (
    MAX_MODEL_STEP_S,
    make_fill,
    make_input_rows,
    make_no_switch,
    make_stage_run,
)
from topdress.control.machine.start_lag import find_first_fall_s, set_carried_share

N = 3000


def drive(step_s: float = 0.05, jitter: float = 0.0) -> tuple[Any, Any, Any, Any]:
    rng = np.random.default_rng(5)
    time_s = np.arange(N) * step_s + jitter * rng.uniform(0.0, step_s, N)
    command = np.repeat(rng.uniform(0, 100, N // 20), 20).round(1)
    opening = np.repeat(rng.uniform(5, 60, N // 30), 30).round(1)
    return time_s, command, opening, 13.5 + rng.normal(0, 0.4, N)


CASES: list[tuple[str, Any, Any, Any]] = [
    (
        "shaft",
        Shaft(
            extra_dead_time_s=0.07, dead_band_rpm=15.0, sag_percent_per_v=3.0, encoder_step_rpm=1.0
        ),
        step_shaft,
        compiled.run_shaft,
    ),
    ("shaft", Shaft(second_order_s=0.3, time_constant_s=0.12), step_shaft, compiled.run_shaft),
    (
        "shaft",
        Shaft(second_order_s=0.02, time_constant_s=0.3, one_way=1.0),
        step_shaft,
        compiled.run_shaft,
    ),
    (
        "shaft",
        Shaft(second_order_s=0.4, acceleration_rpm_s=1e6, one_way=1.0),
        step_shaft,
        compiled.run_shaft,
    ),
    (
        "gate",
        Gate(backlash_mm=0.7, lost_mm_per_100mm=0.05, offset_mm=0.4),
        step_gate,
        compiled.run_gate,
    ),
    (
        "flow",
        Flow(
            fill_falloff_percent=6.0,
            bridging_percent=10.0,
            pulsation_percent=5.0,
            hopper_head_percent=2.0,
        ),
        step_flow,
        compiled.run_flow,
    ),
    ("speed", Speed(gnss_latency_s=0.33, slip_percent=6.0), step_speed, compiled.run_speed),
]


# their steps are exact however long a command is held
EXACT = ("shaft", "gate")


def arguments(
    stage: str, params: Any, step_s: float, jitter: float, most: float = MAX_MODEL_STEP_S
) -> tuple[Any, ...]:
    time_s, command, opening, supply = drive(step_s, jitter)
    if stage == "shaft":
        rows = make_input_rows(
            ShaftInput, N, command_rpm=command, opening_mm=opening, supply_v=supply
        )
        return (
            (params,),
            make_no_switch(),
            make_shaft_start(),
            ShaftOutput(0.0, 0.0),
            rows,
            time_s,
            most,
        )
    if stage == "gate":
        rows = make_input_rows(GateInput, N, command_mm=opening)
        return (
            (params,),
            make_no_switch(),
            make_gate_start(20.0),
            GateOutput(20.0, 20.0),
            rows,
            time_s,
            most,
        )
    if stage == "flow":
        rows = make_input_rows(FlowInput, N, shaft_rpm=command, opening_mm=opening)
        return (
            (params,),
            make_no_switch(),
            make_flow_start(300.0),
            FlowOutput(0.0, 300.0),
            rows,
            time_s,
            most,
        )
    rows = make_input_rows(SpeedInput, N, speed_mps=command / 50.0, working=1.0)
    return (
        (params,),
        make_no_switch(),
        make_speed_start(),
        SpeedOutput(0.0, 0.0),
        rows,
        time_s,
        most,
    )


@pytest.mark.parametrize("jitter", [0.0, 0.5])
@pytest.mark.parametrize(("stage", "params", "step", "run"), CASES, ids=[c[0] for c in CASES])
def test_interpreted_equals_compiled(
    stage: str, params: Any, step: Any, run: Any, jitter: float
) -> None:
    interpreted = make_stage_run(step, exact=stage in EXACT)(
        *arguments(stage, params, 0.05, jitter)
    )
    assert np.array_equal(interpreted, run(*arguments(stage, params, 0.05, jitter)))
    assert np.ptp(interpreted[:, 0]) > 0.0


@pytest.mark.parametrize("row_s", [0.02, 0.05, 1.0])
@pytest.mark.parametrize(("stage", "params", "step", "run"), [c for c in CASES if c[0] in EXACT])
def test_one_step_a_row_is_as_good_as_many(
    stage: str, params: Any, step: Any, run: Any, row_s: float
) -> None:
    at_once = run(*arguments(stage, params, row_s, 0.5))
    cut = compiled.compile_stage_run(step)(*arguments(stage, params, row_s, 0.5))
    off = np.abs(at_once - cut).max(axis=1)
    # a speed half-way between two counts of the encoder may be read as either
    if stage == "shaft":
        off = np.where(np.abs(off - params.encoder_step_rpm) < 1e-6, 0.0, off)
    assert off.max() < 1e-6
    assert np.ptp(at_once[:, 0]) > 10.0


def test_a_command_cannot_show_in_its_own_row() -> None:
    time_s = np.arange(100) * 0.05
    rows = make_input_rows(GateInput, 100, command_mm=np.where(np.arange(100) >= 50, 30.0, 20.0))
    p = Gate(dead_time_s=0.0)
    out = compiled.run_gate(
        (p,),
        make_no_switch(),
        make_gate_start(20.0),
        GateOutput(20.0, 20.0),
        rows,
        time_s,
        MAX_MODEL_STEP_S,
    )
    assert out[50, 0] == 20.0
    assert out[51, 0] == pytest.approx(21.0)


def test_an_effect_may_begin_mid_run() -> None:
    sets, _, *rest = arguments("shaft", Shaft(), 0.05, 0.0)
    late = compiled.run_shaft((sets[0], Shaft(gain_percent=10.0)), np.array([1500]), *rest)
    never = compiled.run_shaft(sets, make_no_switch(), *rest)
    assert np.array_equal(late[:1501], never[:1501])
    assert not np.array_equal(late[1510:1600], never[1510:1600])


def test_the_cache_folder_is_named_by_the_sources() -> None:
    assert len(compiled.CACHE_DIR.name) == 12


def test_a_stage_compiles_without_counting_references(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Counting those of its line's arrays at each step took four fifths of a diagnosis' runs of
    the model."""
    # code that comes from the disk shows no listing
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    fill = compiled.compile_function(make_fill(step_gate, exact=True), makes_arrays=False)
    given = arguments("gate", Gate(), 0.05, 0.0)
    out = np.empty((N, 2))
    fill(out, *given)
    assert np.array_equal(out, compiled.run_gate(*arguments("gate", Gate(), 0.05, 0.0)))
    listing = "".join(fill.inspect_llvm().values())
    assert "gate_step" in listing and "NRT_incref" not in listing


# --- What a rig that times starts cannot tell apart: the share of the pace that the stream in
# the tube sets ----------

MACHINE = Machine()


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_every_share_has_the_same_starts(share: float) -> None:
    """10 ms: a third of the scatter of lag table 3."""
    fall = set_carried_share(MACHINE, share).fall
    off = [
        find_first_fall_s(MACHINE, fall, n) - find_start_drop_s(fall, n)
        for n in (10.0, 30.0, 50.0, 70.0)
    ]
    assert np.abs(off).max() < 0.01


def test_singly_the_running_drop_is_the_line_that_eq_6_allows_as_well() -> None:
    """1.7916 - 0.01331 n s: fitted by the referee of this model, with code of his own."""
    fall = set_carried_share(MACHINE, 0.0).fall
    for rpm in (10.0, 40.0, 70.0):
        assert calc_drop_s(fall, rpm) == pytest.approx(1.7916 - 0.01331 * rpm, abs=0.005)
    assert calc_drop_s(fall, 70.0) < calc_drop_s(MACHINE.fall, 70.0) - 0.3, (
        "and a third of a second quicker than carried along"
    )


def test_there_and_back_is_the_same_machine() -> None:
    again = set_carried_share(set_carried_share(MACHINE, 0.0), 1.0)
    for rpm in (10.0, 40.0, 70.0):
        assert calc_drop_s(again.fall, rpm) == pytest.approx(
            calc_drop_s(MACHINE.fall, rpm), abs=0.003
        )
    with pytest.raises(ValueError, match=r"carried_share 1\.5: allowed 0 to 1"):
        set_carried_share(MACHINE, 1.5)


def test_the_share_goes_from_each_granule_s_own_fall_to_the_stream_s() -> None:
    time_s = np.arange(0.0, 8.0, 0.05)
    rpm = np.where(time_s < 4.0, 40.0, 80.0)
    settled = np.array([calc_drop_s(MACHINE.fall, n) for n in rpm.tolist()])
    assert calc_fall_times_s(time_s, settled, 1.0) == pytest.approx(calc_carried_s(time_s, settled))
    assert calc_fall_times_s(time_s, settled, 0.0) == pytest.approx(settled)
    # released before the step, still falling after it
    late = int(np.searchsorted(time_s, 3.5))
    each = [calc_fall_times_s(time_s, settled, share)[late] for share in (0.0, 0.3, 0.6, 1.0)]
    assert each == sorted(each, reverse=True) and each[0] - each[-1] > 0.1


def test_the_set_has_the_machines_that_it_says() -> None:
    assert (
        make_plausible_machine(MACHINE, "singly").fall.carried_share == 0.0
        and make_plausible_machine(MACHINE, "carried_along") == MACHINE
    )
    assert list_effect_sizes(make_plausible_machine(MACHINE, "flow_6_more")) == {"flow.gain": 6.0}
    assert list_effect_sizes(make_plausible_machine(MACHINE, "field_lag")) == {"lag.offset": 0.3}
    slow = make_plausible_machine(MACHINE, "slow_drives")
    assert slow.shaft.dead_time_s == pytest.approx(
        1.2 * 0.373
    ) and slow.gate.slew_mm_s == pytest.approx(20.0 / 1.2)
    assert len(
        {make_plausible_machine(MACHINE, name).model_dump_json() for name in PLAUSIBLE_MACHINES}
    ) == len(PLAUSIBLE_MACHINES), "no two alike"
    with pytest.raises(
        ValueError, match="plausible machine 'falling': allowed carried_along, singly"
    ):
        make_plausible_machine(MACHINE, "falling")


# --- Compiled code on disk: variants have files and symbols of their own, and a damaged folder
# never ends the program.

ROOT = Path(__file__).resolve().parents[2]
# Two variants of one source over the same types, each called; prints what both give.
PROGRAM = """
import json
import sys
import numpy as np
from topdress.control.machine import compiled
def made(factor):
    def run(values):
        out = np.empty(len(values))
        for k in range(len(values)):
            out[k] = factor * values[k]
        return out
    return compiled.compile_function(run)
print([float(made(factor)(np.ones(2))[1]) for factor in json.loads(sys.argv[1])])
print("scipy.linalg" in sys.modules, file=sys.stderr)
"""


def times(factor: float) -> Callable[..., Any]:
    def run(values):  # type: ignore[no-untyped-def]
        return factor * values[0]

    return run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    import numba

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    return tmp_path / "kept"


def kept(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def called(factor: float) -> tuple[float, bool]:
    """What it gives, and whether it came from the disk."""
    made = compiled.compile_function(times(factor))
    answer = made(np.ones(1))
    return float(answer), bool(sum(made.stats.cache_hits.values()))


def test_variants_have_names_of_their_own() -> None:
    names = [rename_uniquely(times(factor)).__qualname__ for factor in (2.0, 3.0)]
    assert len(set(names)) == 2 and all(name.isascii() and " " not in name for name in names)
    gate, shaft = (
        rename_uniquely(make_fill(step, exact=True)).__qualname__
        for step in (step_gate, step_shaft)
    )
    assert gate != shaft and "gate_step" in gate


@pytest.mark.exam
def test_what_is_damaged_is_compiled_anew(folder: Path) -> None:
    assert called(2.0) == (2.0, False) and called(3.0) == (3.0, False)
    assert called(2.0) == (2.0, True) and called(3.0) == (3.0, True)
    files = kept(folder)
    assert len(files) == 2
    whole = {path: path.read_bytes() for path in files}
    for spoilt in (
        lambda data: b"",
        lambda data: data[: len(data) // 2],
        lambda data: bytes(len(data)),
        lambda data: b"garbage\n" * 99,
        lambda data: data[:-100] + bytes([data[-100] ^ 4]) + data[-99:],
        lambda data: next(other for other in whole.values() if other != data),
    ):
        for path, data in whole.items():
            path.write_bytes(spoilt(data))
        assert called(2.0) == (2.0, False) and called(3.0) == (3.0, False)
        assert called(2.0) == (2.0, True), "kept again"
        assert kept(folder) == files, "nothing else is left in the folder"


def test_without_a_folder_or_room_it_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert called(5.0) == (5.0, False) and not kept(folder)

    def nowhere(*_: Any) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(CompiledCodeCache, "__init__", nowhere)
    assert called(6.0) == (6.0, False)


@pytest.mark.exam
def test_variants_that_two_processes_kept_live_together_in_a_third(tmp_path: Path) -> None:
    """Each is the first of its process: by numba's own cache both had one symbol. The third
    compiles nothing, and loads nothing that only compiling asks for."""
    env = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA")}
    env |= {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    for wanted in ("[2.0]", "[3.0]", "[2.0, 3.0]"):
        done = subprocess.run(
            [sys.executable, str(program), wanted],
            env=env,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0 and done.stdout.strip() == wanted, done.stderr[-2000:]
        assert (done.stderr.strip() == "True") == (wanted != "[2.0, 3.0]"), done.stderr[-2000:]
    assert len(kept(tmp_path / "cache")) == 2


def test_a_number_that_changed_in_its_own_file_is_compiled_anew(
    tmp_path: Path, folder: Path
) -> None:
    """A constant of a module stands in no bytecode: the kept code of before would go on with
    the old one."""
    file = tmp_path / "scaled.py"

    def answer(factor: float) -> float:
        file.write_text(f"FACTOR = {factor}\n\ndef run(values):\n    return FACTOR * values[0]\n")
        space: dict[str, Any] = {}
        exec(compile(file.read_text(), str(file), "exec"), space)
        return float(compiled.compile_function(space["run"])(np.ones(1)))

    assert answer(2.0) == 2.0 and answer(3.0) == 3.0
