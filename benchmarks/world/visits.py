"""Which states, alarms, refusals and events have days visited? What none has visited is listed, and
days are drawn towards it."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Mapping

from topdress.console.app.frame_words import ANSWER_TEXTS
from topdress.control.orders import Do, State
from topdress.control.safety import ALARMS, INTERLOCKS
from topdress.drivers.virtual.faults import LINE_FAULTS

from world.invariants import ALLOWED_CHANGES
from world.plan import DISK_KINDS, DRAWS, LIES

# All names that days can visit, by kind.
UNIVERSE: Mapping[str, tuple[str, ...]] = {
    "state": tuple(State),
    "change": tuple(sorted(f"{before} -> {after}" for before, after in ALLOWED_CHANGES)),
    "alarm": tuple(ALARMS),
    "interlock": tuple(INTERLOCKS),
    "refusal": tuple(ANSWER_TEXTS),
    "order": tuple(Do),
    "line": tuple(LINE_FAULTS),
    "lie": tuple(LIES),
    "disk": DISK_KINDS,
}
# Draws that lead to a name that is seldom visited; `plan.draw_kind` explains them.
WAYS: Mapping[str, tuple[str, ...]] = {
    "shaft_turns": ("lie:shaft_turns_rpm",),
    "gate_opens": ("lie:gate_stands_mm", "order:hold"),
    "valve_open": ("farm:sections", "lie:valve_stays_open"),
    "flow_unordered": ("lie:scale_leaks_kg_s", "order:stop"),
    "shaft_silent": ("line:board",),
    "gate_silent": ("line:board",),
    "drive_fault": ("lie:driver_fault",),
    "drive_stopped": ("reset",),
    "shaft_far_off": ("lie:shaft_turns_times",),
    "gate_far_off": ("lie:gate_stands_mm",),
    "calibration_moved": ("calibrate", "drive"),
    "flow_missing": ("lie:scale_reads_kg", "long"),
    "flow_above": ("lie:scale_leaks_kg_s", "long"),
    "flow_disagrees": ("lie:scale_times", "long"),
    "scale_unexplained": ("lie:scale_reads_kg", "pour"),
    "hopper_empty": ("hopper:3", "long"),
    "hopper_low": ("hopper:33", "long"),
    "speed_silent": ("line:board", "line:gnss"),
    "speeds_differ": ("lie:wheel_times", "gnss_hz:1"),
    "wheel_too_much": ("lie:wheel_times", "long"),
    "wheel_too_little": ("lie:wheel_times", "long"),
    "gnss_speed_wrong": ("lie:gnss_speed_times", "long"),
    "wheel_fault": ("lie:wheel_times",),
    "control_failed": ("raises:loop",),
    "device_aside": ("raises:device",),
    "old_orders": ("replay",),
    "log_failed": ("disk:full",),
    "log_cut": ("disk:cut_by_others",),
    "target_silent": ("farm:external", "asked_rate"),
    "target_cut": ("farm:external", "asked_rate", "order:nudge"),
    "position_lost": ("farm:map", "line:gnss"),
    "position_walks": ("lie:place_walks_mps", "long"),
    "position_jumped": ("lie:place_jumps_m",),
    "heads_full": ("lie:heads_read", "farm:canopy"),
    "heads_few": ("line:head_1", "line:head_2", "line:head_3", "farm:canopy"),
    "ndvi_silent": ("farm:canopy", *(f"line:head_{number}" for number in range(1, 7))),
    "scale_silent": ("line:board",),
    "effort_high": ("lie:effort_times", "long"),
    "effort_low": ("lie:effort_times", "long"),
    "rate_far_off": ("lie:shaft_turns_times", "long"),
    "rate_off": ("lie:gate_reads_more_mm", "long"),
    "shaft_off": ("lie:shaft_turns_times", "long"),
    "gate_off": ("lie:gate_reads_more_mm", "long"),
    "rate_above_range": ("farm:manual", "order:manual_rate", "drive"),
    "rate_below_range": ("farm:manual", "order:manual_rate"),
    "rate_above_limit": ("farm:manual", "order:manual_rate", "lie:shaft_turns_times"),
    "refill_disagrees": ("order:refill", "pour"),
    "work_switch_up": ("lie:switch_up",),
    "reversing": ("drive", "order:start"),
    "no_lag_rig": ("lag_test",),
    "device_in_use": ("device",),
}
# Names that this world cannot reach, with the reason.
OUT_OF_REACH: Mapping[str, str] = {
    "outlet_blocked": "needs a blocked outlet for minutes: drives_disobey has it",
    "flow_below": "needs another lot for minutes: drives_disobey has it",
    "heads_by_map": "needs an index map",
    "target_refused": "no source passes such a target: unit tests have it",
}


class Coverage:
    """Counts visits by kind and name."""

    def __init__(self) -> None:
        self.counts: Counter[tuple[str, str]] = Counter()
        self._today: set[tuple[str, str]] = set()

    def note(self, kind: str, name: str) -> None:
        """Counts one visit; a day counts each name once."""
        self._today.add((kind, str(name)))

    def end_day(self) -> None:
        """Ends a day."""
        self.counts.update(self._today)
        self._today.clear()

    def list_missing(self, kind: str) -> list[str]:
        """Returns the names of a kind that no day has visited."""
        return [str(name) for name in UNIVERSE[kind] if not self.counts[kind, str(name)]]

    def choose_kinds(self, seed: int) -> tuple[str, ...]:
        """Returns the draws that lead to a name not visited yet; empty for every other day."""
        r = random.Random(seed)
        missing = [
            name
            for kind in UNIVERSE
            for name in self.list_missing(kind)
            if name in WAYS or kind in ("lie", "order", "disk", "line")
        ]
        if not missing or r.random() < 0.5:
            return ()
        name = r.choice(missing)
        if name in WAYS:
            return WAYS[name]
        return (
            f"lie:{name}" if name in LIES else f"disk:{name}" if name in DISK_KINDS else "order",
        )

    def format_table(self) -> str:
        """Returns the table: kind, visited of all, and what is missing."""
        lines = []
        for kind, names in UNIVERSE.items():
            missing = self.list_missing(kind)
            lines.append(f"{kind:9} {len(names) - len(missing):3d} of {len(names):3d}")
            lines[-1] += f"  never: {', '.join(missing)}" if missing else ""
        return "\n".join(lines)


assert all(
    way.partition(":")[0] in (*DRAWS, "farm", "hopper", "gnss_hz", "long")
    for ways in WAYS.values()
    for way in ways
)
