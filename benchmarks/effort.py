"""What the metering drive's effort says of bridges and blocked outlets, and for nothing:
`python -m benchmarks effort`

`planted [SEEDS]`: a bridge, and one of six outlets blocked, in closed loop, with a scale and
without: seconds from the beginning until the cab says it, and what a diagnosis of the run says.

`healthy [HOURS]`: alarms of effort of a sound machine. `price`: what is said where nothing is
wrong with the flow: 12 V in place of 13.5 V, a cold start, a full hopper that weighs on the
rollers. `actuator`: recordings whose cause is known (../shared/data/known_causes), answers
written down before (tests/diagnosis/known_causes.py).
"""

from __future__ import annotations

import datetime as dt
import sys
from collections.abc import Callable
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
from verdict import exit_code

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from topdress.console.reports.diagnosis_wording import format_verdict_line  # noqa: E402
from topdress.control.diagnosis import diagnose_run  # noqa: E402
from topdress.control.loop.tick import Tick  # noqa: E402
from topdress.control.machine.fault_injection import parse_planted  # noqa: E402
from topdress.control.readings import Measurements, Reading  # noqa: E402
from topdress.control.simulation.assembly import (  # noqa: E402
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import simulate_run  # noqa: E402
from topdress.drivers.files.run_setup import load_setup  # noqa: E402

SETUP = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
DT_S, LOG_S = 0.05, 180.0
SAID_S = 10.0  # within which it is to be said
# what, when its first spell begins, and its names; the bridge stands for spells of 12 s
PLANTED = {
    "bridge": ("flow.bridging=30@60", 84.0, "effort_low", "flow.bridging"),
    "blocked outlet": ("flow.blocked_outlet=16.7@60", 60.0, "effort_high", "flow.blocked_outlet"),
}
Change = Callable[[Measurements], Measurements]


class OtherwiseSensed:
    """A control loop that hears something else than the sensors say."""

    def __init__(self, loop: Any, change: Change) -> None:
        self._loop, self._change = loop, change

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loop, name)

    def run_tick(self, m: Measurements) -> Tick:
        tick: Tick = self._loop.run_tick(self._change(m))
        return tick


def alarms_of(
    seconds: float,
    seed: int = 1,
    effects: tuple[str, ...] = (),
    change: Change = lambda m: m,
    rows: list[Any] | None = None,
) -> list[tuple[float, float, str, float]]:
    """Alarms of effort: from, to (s), id, the most per cent that it said. rows: takes the log's
    rows."""
    job = add_simulated_field(SETUP.job, SETUP.machine)
    plant = make_plant(SETUP.machine, job, seed, DT_S, [parse_planted(text) for text in effects])
    loop: Any = OtherwiseSensed(
        make_control_loop(SETUP.machine, SETUP.crop, SETUP.rule, job), change
    )
    found: dict[str, tuple[float, float, str, float]] = {}
    over: list[tuple[float, float, str, float]] = []
    for step in simulate_run(plant, loop, seconds):
        at, now = step.tick.row.time_s, set()
        for alarm in step.tick.alarms:
            if alarm.id.startswith("effort") and alarm.gone_s is None:
                said = float(dict(alarm.details).get("percent", 0.0))
                began, _end, _id, most = found.get(alarm.id, (at, at, alarm.id, 0.0))
                found[alarm.id] = began, at, alarm.id, max(most, said)
                now.add(alarm.id)
        over += [found.pop(one) for one in list(found) if one not in now]
        if rows is not None:
            rows.append(step.tick.row)
    return sorted([*over, *found.values()])


def columns_of(rows: list[Any]) -> dict[str, Any]:
    """A run log's columns of its rows."""
    found = {}
    for name in rows[0]._fields:
        values = [getattr(row, name) for row in rows]
        texts = any(isinstance(value, str) for value in values)
        found[name] = (
            np.array([value or "" for value in values], object)
            if texts
            else np.array([np.nan if value is None else value for value in values], float)
        )
    return found


def without_scale(m: Measurements) -> Measurements:
    return m._replace(hopper_kg=None)


def planted(seeds: int) -> dict[str, object]:
    promises: dict[str, object] = {}
    print(
        f"{'':15s} {'scale':>6s}  said right within {SAID_S:g} s   seconds, seed by seed; "
        "what a diagnosis says"
    )
    for name, (effect, begins_s, alarm, cause) in PLANTED.items():
        for scale in (True, False):
            times, said = [], {}
            for seed in range(1, seeds + 1):
                rows: list[Any] = []
                found = alarms_of(
                    LOG_S, seed, (effect,), (lambda m: m) if scale else without_scale, rows
                )
                first = next((one for one in found if one[1] >= begins_s), None)
                right = first is not None and first[2] == alarm
                times.append(first[0] - begins_s if first is not None and right else np.inf)
                causes = diagnose_run(columns_of(rows), SETUP.machine).causes
                words = (
                    "; ".join(
                        f"{one.id} {one.probability:.2f}"
                        + "".join(f" or {rival.id} {rival.probability:.2f}" for rival in one.rivals)
                        for one in causes
                    )
                    or "nothing"
                )
                said[words] = said.get(words, 0) + 1
            good = sum(0.0 <= one <= SAID_S for one in times)
            print(
                f"{name:15s} {'yes' if scale else 'no':>6s}  {good} of {seeds}   "
                + " ".join(f"{one:.1f}" for one in times),
                flush=True,
            )
            for words, count in said.items():
                print(f"{'':24s}{count} x {words}", flush=True)
            promises[f"{name}, scale {scale}: said in 9 of 10"] = good >= 0.9 * seeds
            named = sum(count for words, count in said.items() if cause in words)
            promises[f"{name}, scale {scale}: among what a diagnosis names"] = named >= 0.9 * seeds
    return promises


def healthy(hours: int) -> dict[str, object]:
    """An hour a seed."""
    cries = []
    for seed in range(1, hours + 1):
        cries += alarms_of(3600.0, seed)
        print(f"hour {seed} of {hours}: {len(cries)} alarms of effort so far", flush=True)
    return {"no alarm of effort": not cries}


def price() -> dict[str, object]:
    """Said, not promised."""
    own = SETUP.machine.effort

    def volts(measured: bool) -> Change:
        return lambda m: m._replace(
            shaft_effort=None
            if m.shaft_effort is None
            else Reading(m.shaft_effort.value * 13.5 / 12.0, m.time_s),
            supply_v=m.supply_v._replace(value=m.supply_v.value * 12.0 / 13.5)
            if measured and m.supply_v
            else None,
        )

    def cold(times: float) -> Change:
        """Grease so many times as stiff as when warm, warm after some ten minutes."""

        def change(m: Measurements) -> Measurements:
            rpm = 0.0 if m.shaft_rpm is None else abs(m.shaft_rpm.value)
            more = (times - 1.0) * own.viscous * rpm * exp(-m.time_s / 600.0)
            return m._replace(
                shaft_effort=None
                if m.shaft_effort is None
                else Reading(min(100.0, m.shaft_effort.value + more), m.time_s)
            )

        return change

    def weighs(percent: float) -> Change:
        """A full hopper presses on the rollers, so many per cent more of the material's load."""

        def change(m: Measurements) -> Measurements:
            kg = 0.0 if m.hopper_kg is None else m.hopper_kg.value
            more = 0.01 * percent * own.load * 137.5 * kg / SETUP.machine.flow.full_kg
            return m._replace(
                shaft_effort=None
                if m.shaft_effort is None or m.shaft_effort.value < 5.0
                else Reading(m.shaft_effort.value + more, m.time_s)
            )

        return change

    for name, change in {
        "12 V, measured": volts(True),
        "12 V, not measured": volts(False),
        "cold, grease 1.2 times": cold(1.2),
        "cold, grease 2 times": cold(2.0),
        "full hopper weighs 25 %": weighs(25.0),
        "full hopper weighs 100 %": weighs(100.0),
        "full hopper weighs nothing": lambda m: m,
    }.items():
        found = alarms_of(1800.0, 1, (), change)
        said = "; ".join(
            f"{id} {most:.0f} % from {begin:.0f} to {end:.0f} s" for begin, end, id, most in found
        )
        print(f"{name:28s} {said or 'nothing said in 1800 s'}", flush=True)
    return {"it ran": True}


def actuator() -> dict[str, object]:
    from tests.diagnosis.known_causes import EXPECTED
    from tests.diagnosis.test_effort import recorded, sound_screw

    promises: dict[str, object] = {}
    for one in EXPECTED:
        found = diagnose_run(recorded(one.recording, one.load_kgf), sound_screw(one.load_kgf))
        causes = [(cause.id, cause.size) for cause in found.causes]
        words = ", ".join(
            f"{id} {size.value:.1f} % ({size.low:.1f} to {size.high:.1f})" for id, size in causes
        )
        hidden = any("does not show at this load" in note for note in found.findings)
        print(
            f"{one.recording:16s} {one.load_kgf:4d} kgf  expected {one.cause or 'none':8s} "
            f"{one.percent or '':4}  "
            f"found {words or format_verdict_line(found)}"
            f"{'; what this load hides is said' if hidden else ''}"
        )
        holds = [id for id, _ in causes] == (["effort.gate_friction"] if one.cause else []) and all(
            size.low < one.percent < size.high for _, size in causes
        )
        promises[f"{one.recording} {one.load_kgf}: as expected"] = holds
    return promises


if __name__ == "__main__":
    words = sys.argv[1:] or ["planted", "healthy", "price", "actuator"]
    promised: dict[str, object] = {}
    for k, word in enumerate(words):
        count = int(words[k + 1]) if k + 1 < len(words) and words[k + 1].isdigit() else 10
        if not word.isdigit():
            print(f"\n{word}")
            promised |= (
                planted(count)
                if word == "planted"
                else healthy(count)
                if word == "healthy"
                else {"price": price, "actuator": actuator}[word]()
            )
    sys.exit(exit_code(promised))
