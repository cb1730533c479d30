"""What does docs/safety.md promise? Each function is one promise, asked at every tick of a run."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from topdress.console.frame import Frame
from topdress.control.orders import Do, Severity, State
from topdress.control.readings import DriveCommand

# Time from the end of a permission until nothing flows, s: an orphaned board stops after 1 s, and a
# shaft runs down.
FLOW_ENDS_S = 3.0
# A smaller flow is the rest of a run-down, kg/s.
NO_FLOW_KG_S = 2e-3
# Longest time from STOP to its execution, s.
STOP_S = 0.5
# Time after which a silent console ends flow, s.
CONSOLE_SILENCE_S = 2.0
# Time after which a silent console means off, s.
CONSOLE_GONE_S = 60.0
# Distance outside the field within which material may still land inside, m.
OUTSIDE_M = 4.0
# Time until a drive that turns although it should stand is reported, s, by the table of hazards.
DISOBEYS_S = 2.0
# Time within which the operator's three keys bring the machine back to work, s.
RECOVERS_S = 10.0
# Deviation of the counted mass from the plant's: share, and kg.
COUNTED_SHARE, COUNTED_KG = 0.04, 0.4
# Deviation of the ground's rate that must be reported, and its duration, s. The margin over 10 % is
# that of edges and lags.
GROUND_SHARE, GROUND_S = 0.15, 30.0
# Length of ground that a cut may cover twice, m.
TWICE_M = 2.0

ALLOWED_CHANGES = {
    ("off", "ready"),
    ("ready", "working"),
    ("held", "working"),
    ("working", "held"),
    ("held", "ready"),
    ("ready", "calibrating"),
    ("calibrating", "ready"),
    ("fault", "ready"),
    *((state, "fault") for state in ("ready", "working", "held", "calibrating")),
    *((state, "off") for state in ("ready", "working", "held", "calibrating", "fault")),
}
# Alarms that a sound machine may have: they describe the work, not a fault.
SOUND_ALARMS = {
    "hopper_low",
    "lead_short",
    "flow_trimmed",
    "target_cut",
    "rate_above_range",
    "rate_below_range",
    "rate_off",
}
# Alarms that say nothing about the rate on the ground.
UNRELATED_ALARMS = {"hopper_low", "lead_short", "console_silent", "log_failed", "log_cut"}
# Interlocks that last after the end of a fault, as the tables say, or belong to the place.
LASTING_INTERLOCKS = {
    "outside_field",
    "below_range",
    "standstill",
    "low_speed",
    "reversing",
    "course_unknown",
    "map_elsewhere",
    "position_lost",
    "wheel_speed_missing",
    "gnss_speed_missing",
    "log_failed",
}


class Broken(BaseException):
    """Reports a promise that does not hold."""

    def __init__(self, promise: str, text: str) -> None:
        super().__init__(f"{promise}: {text}")
        self.promise = promise


class AnsweredOrder(NamedTuple):
    """Holds an order with its answer: time of sending and of the answer, s, both world time."""

    sent_s: float
    at_s: float
    do: str
    value: Any
    accepted: bool
    why: str


class Moment(NamedTuple):
    """Holds everything about one tick that a promise needs; times are world time, s."""

    now_s: float
    part_begin_s: float
    # Time at which a suspended or late computer last ran again.
    late_s: float
    frame: Frame
    state: str
    state_before: str | None
    command: DriveCommand | None
    enabled: bool
    # Accepted and refused orders since the tick before.
    orders: tuple[AnsweredOrder, ...]
    heard_s: float
    # By the plant.
    flow_kg_s: float
    true_kg: float
    true_speed_mps: float
    lies: tuple[str, ...]
    # Time at which a drive last turned by itself, s.
    disobeyed_s: float
    line_faults: tuple[str, ...]
    disk_struck: bool
    reported: frozenset[str]
    link_counts: dict[str, int]
    width_m: float
    max_rpm: float
    max_mm: float
    calm: bool
    # Seconds since the last lie or line fault, or inf.
    sound_s: float
    log_ok: bool
    # Distance of the outlets outside the field, m; negative inside.
    outside_m: float


class Promises:
    """Asks every promise at every tick. `check_tick` raises Broken."""

    def __init__(self) -> None:
        self._allowed_s = -math.inf
        self._turns_since_s: float | None = None
        self._kg = self._ha = 0.0
        self._window: deque[tuple[float, float, float, bool]] = deque()
        self._red: frozenset[str] = frozenset()
        self._button_s = -math.inf
        self._log_bad_s: float | None = None
        self._moving_s: float | None = None
        self._kg_true0: float | None = None
        self._kg_counted0 = 0.0

    def begin_part(self, now_s: float) -> None:
        """Forgets what ended with the worker."""
        self._window.clear()
        self._kg_true0 = None

    def check_tick(self, m: Moment) -> None:
        """Checks every promise of a tick."""
        for promise in PROMISES:
            promise(self, m)

    def no_flow_but_where_allowed(self, m: Moment) -> None:
        """Nothing flows 3 s after flow was last allowed, whatever line, worker or console do."""
        if not m.frame.why_no_flow or m.state == State.CALIBRATING:
            self._allowed_s = m.now_s
        self._allowed_s = max(self._allowed_s, m.disobeyed_s)
        if m.flow_kg_s > NO_FLOW_KG_S and m.now_s - self._allowed_s > FLOW_ENDS_S:
            raise Broken(
                "no_flow_but_where_allowed",
                f"{m.flow_kg_s:.4f} kg/s {m.now_s - self._allowed_s:.1f} s after the permission, "
                f"state {m.state}, {m.frame.why_no_flow}",
            )

    def flow_needs_its_state(self, m: Moment) -> None:
        """Flow is allowed and the drives turn only while working or calibrating."""
        may = m.state in (State.WORKING, State.CALIBRATING)
        if not may and (not m.frame.why_no_flow or (m.command and m.command.shaft_rpm > 0.0)):
            raise Broken("flow_needs_its_state", f"{m.state}: {m.command}")

    def states_change_as_the_table_says(self, m: Moment) -> None:
        """States change along the arrows of the table only; several orders in a tick make
        several."""
        before, accepted = m.state_before, sum(one.accepted for one in m.orders)
        if before in (None, m.state) or accepted > 1:
            return
        ways = ALLOWED_CHANGES | {("off", "fault")}
        # An order, and then a cause that ends work, may both act in a tick.
        ends = m.state in (State.HELD, State.FAULT, State.OFF) and accepted
        between = ends and any(
            (before, state) in ways and (state, m.state) in ways for state in State
        )
        if not between and (before, m.state) not in ways:
            raise Broken("states_change_as_the_table_says", f"{before} -> {m.state}")

    def work_needs_start(self, m: Moment) -> None:
        """WORKING follows an accepted START only."""
        if m.state == State.WORKING != m.state_before and not any(
            one.do == Do.START and one.accepted for one in m.orders
        ):
            raise Broken("work_needs_start", f"{m.state_before} -> {m.state}")

    def start_needs_acknowledged_alarms(self, m: Moment) -> None:
        """START and CALIBRATE are refused while a red alarm is not acknowledged."""
        before, self._red = (
            self._red,
            frozenset(
                alarm.id
                for alarm in m.frame.alarms
                if alarm.severity is Severity.RED and not alarm.acknowledged
            ),
        )
        begins = m.state != m.state_before and m.state in (State.WORKING, State.CALIBRATING)
        if begins and before and not any(one.do == Do.ACKNOWLEDGE for one in m.orders):
            raise Broken("start_needs_acknowledged_alarms", f"{m.state} with {sorted(before)}")

    def calibrating_needs_the_button_and_standstill(self, m: Moment) -> None:
        """Calibrating ends 0.5 s after the button's release, and by moving."""
        if any(one.do == Do.CALIBRATE for one in m.orders):
            self._button_s = m.now_s
        if m.state != State.CALIBRATING:
            self._moving_s = None
            return
        if m.now_s - max(self._button_s, m.late_s) > 0.5 + 0.25:
            raise Broken("calibrating_needs_the_button_and_standstill", "the button is up")
        if m.true_speed_mps < 0.3 or m.sound_s < 5.0:
            self._moving_s = None
        elif self._moving_s is None:
            self._moving_s = m.now_s
        elif m.now_s - self._moving_s > 1.5:
            raise Broken(
                "calibrating_needs_the_button_and_standstill", f"{m.true_speed_mps:.2f} m/s"
            )

    def no_flow_without_a_log(self, m: Moment) -> None:
        """Without a log nothing flows unless the operator allows it."""
        if m.log_ok or m.frame.allow.unlogged:
            self._log_bad_s = None
            return
        self._log_bad_s = m.now_s if self._log_bad_s is None else self._log_bad_s
        lasts_s = m.now_s - self._log_bad_s
        if lasts_s > 0.5 and m.state == State.WORKING and not m.frame.why_no_flow:
            raise Broken("no_flow_without_a_log", f"flow is allowed after {lasts_s:.1f} s")

    def no_flow_outside_the_field(self, m: Moment) -> None:
        """Nothing flows outside the field, while the position tells the truth."""
        far = m.outside_m > OUTSIDE_M and not m.frame.allow.outside and m.sound_s > 30.0
        if far and m.flow_kg_s > NO_FLOW_KG_S and m.state == State.WORKING:
            raise Broken("no_flow_outside_the_field", f"{m.outside_m:.1f} m outside")

    def stop_is_obeyed(self, m: Moment) -> None:
        """STOP is accepted and executed within 0.5 s of its key, whatever else goes on."""
        for number, one in enumerate(m.orders):
            if one.do != Do.STOP:
                continue
            wait_s = one.at_s - max(one.sent_s, m.late_s)
            later = any(other.accepted for other in m.orders[number + 1 :])
            if not one.accepted or wait_s > STOP_S or (m.state != State.OFF and not later):
                raise Broken("stop_is_obeyed", f"{one}, state {m.state}")

    def set_points_are_limited(self, m: Moment) -> None:
        """Every set-point is finite and within the limits of the drives."""
        if m.command is None:
            return
        rpm, mm = m.command.shaft_rpm, m.command.opening_mm
        if not (0.0 <= rpm <= m.max_rpm + 1e-6 and -1e-6 <= mm <= m.max_mm + 1e-6):
            raise Broken("set_points_are_limited", f"{m.command}")
        if m.frame.why_no_flow and m.state != State.CALIBRATING and rpm > 0.0:
            raise Broken("set_points_are_limited", f"{rpm} r/min despite {m.frame.why_no_flow}")

    def nothing_is_raised(self, m: Moment) -> None:
        """No tick, order, client or frame fails."""
        wrong = [name for name in ("clients_failed", "frames_not_finite") if m.link_counts[name]]
        internal = [one.why for one in m.orders if "internal_error" in one.why]
        if m.reported or wrong or internal:
            raise Broken("nothing_is_raised", f"{sorted(m.reported)} {wrong} {internal}")

    def sums_never_fall(self, m: Moment) -> None:
        """Kilograms and hectares never fall."""
        totals = m.frame.totals
        if totals is None:
            return
        if totals.applied_kg < self._kg - 1e-6 or totals.area_ha < self._ha - 1e-9:
            raise Broken(
                "sums_never_fall",
                f"{self._kg:.3f} kg {self._ha:.4f} ha -> {totals.applied_kg:.3f} kg "
                f"{totals.area_ha:.4f} ha",
            )
        self._kg, self._ha = totals.applied_kg, totals.area_ha

    def counted_is_true(self, m: Moment) -> None:
        """Kilograms counted are the plant's within 4 %, while shaft and gate tell the truth."""
        totals = m.frame.totals
        if totals is None or m.state == State.CALIBRATING or m.sound_s < 60.0 or m.flow_kg_s > 0.0:
            if m.sound_s < 60.0 or m.state == State.CALIBRATING:
                self._kg_true0 = None
            return
        if m.now_s - self._allowed_s < 5.0:
            return
        if self._kg_true0 is None:
            self._kg_true0, self._kg_counted0 = m.true_kg, totals.applied_kg
            return
        true, counted = m.true_kg - self._kg_true0, totals.applied_kg - self._kg_counted0
        if abs(counted - true) > COUNTED_KG + COUNTED_SHARE * true:
            raise Broken("counted_is_true", f"counted {counted:.3f} kg, left {true:.3f} kg")

    def silent_console_ends_flow(self, m: Moment) -> None:
        """Without a console for 2 s work is held, after 60 s off."""
        silent_s = m.now_s - max(m.heard_s, m.late_s, m.part_begin_s)
        if silent_s > CONSOLE_GONE_S + 1.0 and m.state not in (State.OFF, State.FAULT):
            raise Broken("silent_console_ends_flow", f"{m.state} {silent_s:.1f} s alone")
        if silent_s > CONSOLE_SILENCE_S + 0.3 and m.state == State.WORKING:
            raise Broken("silent_console_ends_flow", f"working {silent_s:.1f} s without a console")

    def disobeying_drives_are_reported(self, m: Moment) -> None:
        """A shaft that turns although it is commanded to stop is reported within 2 s."""
        turns = "shaft_turns_rpm" in m.lies and m.frame.row.shaft_rpm_cmd == 0.0
        turns = turns and m.flow_kg_s > 0.0 and "board" not in m.line_faults
        turns = turns and "shaft_reads_times" not in m.lies and m.now_s - m.part_begin_s > 3.0
        if not turns or m.state == State.CALIBRATING or m.now_s - m.late_s < 3.0:
            self._turns_since_s = None
            return
        since_s = self._turns_since_s = (
            m.now_s if self._turns_since_s is None else self._turns_since_s
        )
        ids = {alarm.id for alarm in m.frame.alarms}
        said = ids & {"shaft_turns", "flow_unordered", "drive_fault", "shaft_silent"}
        if m.now_s - since_s > DISOBEYS_S and not said:
            raise Broken("disobeying_drives_are_reported", f"{m.state}, alarms {sorted(ids)}")

    def wrong_ground_is_reported(self, m: Moment) -> None:
        """An alarm tells that the ground gets more than 10 % off for 30 s."""
        row = m.frame.row
        steady = (
            m.state == State.WORKING and not m.frame.why_no_flow and m.true_speed_mps > 0.5
        ) and all(section.open for section in m.frame.sections)
        if not steady:
            self._window.clear()
            return
        said = any(alarm.id not in UNRELATED_ALARMS for alarm in m.frame.alarms)
        self._window.append(
            (m.now_s, m.flow_kg_s, row.target_rate_kg_ha * m.true_speed_mps * m.width_m / 1e4, said)
        )
        while m.now_s - self._window[0][0] > GROUND_S:
            self._window.popleft()
        if m.now_s - self._window[0][0] < GROUND_S - 0.5 or any(one[3] for one in self._window):
            return
        flow, wanted = sum(one[1] for one in self._window), sum(one[2] for one in self._window)
        if abs(flow - wanted) > GROUND_SHARE * wanted and not undetectable(m.lies):
            raise Broken(
                "wrong_ground_is_reported",
                f"{100 * flow / wanted - 100:+.0f} % for 30 s, lies {m.lies}, no alarm",
            )

    def nothing_is_wrong_on_calm_days(self, m: Moment) -> None:
        """A sound machine has no alarm and no stop."""
        if not m.calm:
            return
        ids = {alarm.id for alarm in m.frame.alarms} - SOUND_ALARMS
        if ids or (m.state in (State.FAULT, State.OFF) and m.now_s > 5.0):
            raise Broken("nothing_is_wrong_on_calm_days", f"{m.state}, alarms {sorted(ids)}")


def disobeys(lies: tuple[str, ...]) -> bool:
    """Returns whether a drive turns or opens by itself."""
    return "shaft_turns_rpm" in lies


def undetectable(lies: tuple[str, ...]) -> bool:
    """Returns whether docs/safety.md names the lies as undetected, or two sensors lie at once."""
    return len(lies) > 1


PROMISES: tuple[Callable[[Promises, Moment], None], ...] = (
    Promises.no_flow_but_where_allowed,
    Promises.flow_needs_its_state,
    Promises.states_change_as_the_table_says,
    Promises.work_needs_start,
    Promises.start_needs_acknowledged_alarms,
    Promises.calibrating_needs_the_button_and_standstill,
    Promises.no_flow_without_a_log,
    Promises.no_flow_outside_the_field,
    Promises.stop_is_obeyed,
    Promises.set_points_are_limited,
    Promises.nothing_is_raised,
    Promises.sums_never_fall,
    Promises.counted_is_true,
    Promises.silent_console_ends_flow,
    Promises.disobeying_drives_are_reported,
    Promises.wrong_ground_is_reported,
    Promises.nothing_is_wrong_on_calm_days,
)
