"""How are response and drop time measured over shaft speed? The procedure is that of the lag paper
(section 1.2 and tables 2 to 4): steps of 10 r/min with ten repeats.

Before each run the shaft stands and the plate is quiet. Then the rig is armed and the set-point is
sent. At 2 r/min the rig starts its clock, and the first granule on the plate stops it. The response
is the time from the command to 2 r/min, the drop time that from 2 r/min to the landing. The module
is pure: readings and times enter, set-points and orders leave. It never starts a shaft by itself;
the caller's safety does.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from topdress.drivers.board.lag_rig import ARMED, IDLE, LANDED, TURNING
from topdress.drivers.devices.lag_rig import RigReadings

# Shaft speed below which the shaft counts as standing, r/min.
MAX_STANDSTILL_RPM = 0.5
Phase = Literal["settling", "arming", "running", "done"]


class LagTestPlan(NamedTuple):
    """Defines the runs and the time-outs of their phases."""

    shaft_rpm: tuple[float, ...] = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0)
    repeats: int = 10
    # Standstill before a run, s, so that the granules in the tubes have landed.
    settle_s: float = 3.0
    # Time within which the rig must report that it is armed, s.
    arm_s: float = 1.0
    # Longest time from the command to the landing, s.
    longest_s: float = 8.0
    # Number of attempts of a run before it is abandoned.
    tries: int = 3


class MeasuredLagRun(NamedTuple):
    """Holds one measured run."""

    shaft_rpm: float
    replicate: int
    response_s: float
    drop_s: float

    @property
    def lag_s(self) -> float:
        """Time from the command of a change to the landing of its granules, s."""
        return self.response_s + self.drop_s


class LagOutputs(NamedTuple):
    """Holds the outputs of the procedure at this tick. `run` and `arm` are the order to the rig;
    `failure` describes a failed run with its reason."""

    shaft_rpm: float
    run: int
    arm: bool
    phase: Phase
    # Text about a run that failed, with its reason.
    failure: str = ""


class _RigProcedure:
    """Contains the beginning of both procedures: the shaft must stand long enough for the tubes to
    empty."""

    def __init__(self, settle_s: float) -> None:
        self._settle_s = settle_s
        self._since_s: float | None = None
        self._number = 0

    def _is_rig_settled(self, now_s: float, rig: RigReadings | None) -> bool:
        if (
            rig is None
            or now_s - rig.time_s >= 0.5
            or abs(rig.shaft_rpm.value) >= MAX_STANDSTILL_RPM
        ):
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        return self._since_s is not None and now_s - self._since_s >= self._settle_s


class LagProcedure(_RigProcedure):
    """Measures the runs of a plan; `run_tick` is called at every tick. Measured runs are in `runs`,
    abandoned runs in `left_out`.

    While `allowed` is False (hold-to-run released, or an interlock) the set-point of the shaft is
    0, and the run begins again later.
    """

    def __init__(self, plan: LagTestPlan | None = None) -> None:
        plan = plan or LagTestPlan()
        super().__init__(plan.settle_s)
        self.runs: list[MeasuredLagRun] = []
        self.left_out: list[tuple[float, int, str]] = []
        self._plan = plan
        self._todo = [
            (rpm, repeat) for repeat in range(1, plan.repeats + 1) for rpm in plan.shaft_rpm
        ]
        self._total = len(self._todo)
        self._tries = 0
        self._phase: Phase = "settling" if self._todo else "done"
        self._sent_s = 0.0

    @property
    def is_done(self) -> bool:
        """Whether every run of the plan has ended."""
        return self._phase == "done"

    @property
    def find_present_run(self) -> tuple[float, int]:
        """Returns shaft speed (r/min) and replicate of the present or next run; zeros when the plan
        is done."""
        return self._todo[0] if self._todo else (0.0, 0)

    @property
    def progress(self) -> float:
        """Returns the completed share of the plan, 0 to 1."""
        return 1.0 - len(self._todo) / self._total if self._total else 1.0

    def run_tick(self, now_s: float, rig: RigReadings | None, allowed: bool) -> LagOutputs:
        """Returns the set-point and the rig's order of this tick.

        In the tick whose set-point changes to the run's speed, that speed must be sent at `now_s`,
        because the response is counted from then.

        Parameters
        ----------
        now_s : time on the clock that stamped `rig`, s.
        rig : the newest reading of the rig, however old; None before the first.
        allowed : whether the shaft may turn.
        """
        if self._phase == "done":
            return self._make_outputs()
        if not allowed:
            self._restart_run()
            return self._make_outputs()
        if self._phase == "settling":
            if self._is_rig_settled(now_s, rig):
                self._phase, self._since_s, self._number = "arming", now_s, self._number + 1
        elif self._phase == "arming":
            self._await_arming(now_s, rig)
        else:
            return self._make_outputs(self._watch_run(now_s, rig))
        return self._make_outputs()

    def _await_arming(self, now_s: float, rig: RigReadings | None) -> None:
        if rig is not None and rig.run == self._number and rig.state == ARMED:
            self._phase, self._sent_s = "running", now_s
        elif self._since_s is not None and now_s - self._since_s > self._plan.arm_s:
            self._restart_run()

    def _watch_run(self, now_s: float, rig: RigReadings | None) -> str:
        rpm, repeat = self._todo[0]
        if rig is not None and rig.run == self._number and rig.state == LANDED:
            assert rig.start_s is not None and rig.drop_s is not None
            response_s = rig.start_s - self._sent_s
            if rig.plate_before or rig.turned_before:
                return self._fail_run(
                    "the plate was touched before the shaft turned"
                    if rig.plate_before
                    else "the shaft turned before its command"
                )
            if response_s <= 0.0:
                return self._fail_run(f"the shaft turned {-response_s:.3f} s before its command")
            self.runs.append(MeasuredLagRun(rpm, repeat, response_s, rig.drop_s))
            self._begin_next()
            return ""
        if now_s - self._sent_s > self._plan.longest_s:
            state = rig.state if rig is not None and rig.run == self._number else IDLE
            return self._fail_run("nothing landed" if state > ARMED else "the shaft did not turn")
        return ""

    def _fail_run(self, why: str) -> str:
        rpm, repeat = self._todo[0]
        self._tries += 1
        if self._tries >= self._plan.tries:
            self.left_out.append((rpm, repeat, why))
            self._begin_next()
        else:
            self._restart_run()
        return f"{rpm:g} r/min, repeat {repeat}: {why}"

    def _begin_next(self) -> None:
        self._todo.pop(0)
        self._tries = 0
        self._restart_run()
        if not self._todo:
            self._phase = "done"

    def _restart_run(self) -> None:
        self._phase, self._since_s = "settling", None

    def _make_outputs(self, failure: str = "") -> LagOutputs:
        running = self._phase == "running"
        return LagOutputs(
            self._todo[0][0] if running else 0.0,
            self._number,
            self._phase in ("arming", "running"),
            self._phase,
            failure,
        )


BENCH_COLUMNS = ("shaft_rpm", "replicate", "response_s", "drop_s")


def make_bench_row(run: MeasuredLagRun) -> str:
    """Returns one run as a row of the table, with times to a millisecond."""
    return f"{run.shaft_rpm:g},{run.replicate},{run.response_s:.3f},{run.drop_s:.3f}\n"


def make_bench_table(runs: Iterable[MeasuredLagRun]) -> str:
    """Returns the runs as a lag bench table (CSV) by shaft speed, with both measured times; their
    sum is the lag."""
    ordered = sorted(runs, key=lambda run: (run.shaft_rpm, run.replicate))
    return ",".join(BENCH_COLUMNS) + "\n" + "".join(map(make_bench_row, ordered))


DropPhase = Literal["stop", "arming", "start", "falling"]


class DropRun(NamedTuple):
    """Holds one measured run; the shaft speed is the rig's own reading when the granule landed."""

    shaft_rpm: float
    drop_s: float


class DropOutputs(NamedTuple):
    """Holds the outputs at this tick: `phase` for the person at the machine, `run` and `arm` for
    the rig; `failure` describes a failed run with its reason."""

    run: int
    arm: bool
    phase: DropPhase
    # Text about a run that failed, with its reason.
    failure: str = ""


class DropProcedure(_RigProcedure):
    """Measures drop times with the lag rig alone, on a machine whose own drive turns the shaft
    without this program. It runs until the user ends it; measured runs are in `runs`.

    In each run the shaft stands and the tubes are empty, the rig is armed, and a person starts the
    shaft. The rig measures the time from 2 r/min to the first granule on the plate (lag paper,
    1.2). The response cannot be measured, because the time of the command is unknown.
    """

    def __init__(self, settle_s: float = 3.0, longest_s: float = 8.0) -> None:
        super().__init__(settle_s)
        self.runs: list[DropRun] = []
        self._longest_s = longest_s
        self._phase: DropPhase = "stop"

    def run_tick(self, now_s: float, rig: RigReadings | None) -> DropOutputs:
        """Returns the phase and the rig's order of this tick.

        Parameters
        ----------
        now_s : time on the clock that stamped `rig`, s.
        rig : the newest reading of the rig, however old; None before the first.
        """
        failure = ""
        mine = rig is not None and rig.run == self._number
        if self._phase == "stop":
            if self._is_rig_settled(now_s, rig):
                self._phase, self._number = "arming", self._number + 1
        elif rig is None or not mine:
            pass
        elif self._phase == "arming" and rig.state >= ARMED:
            self._phase = "start"
        elif rig.state == LANDED:
            failure = self._record_landing(rig)
        elif rig.state == TURNING and self._phase == "start":
            self._phase, self._since_s = "falling", now_s
        elif (
            self._phase == "falling"
            and self._since_s is not None
            and now_s - self._since_s > self._longest_s
        ):
            failure = "nothing landed"
            self._restart_run()
        return DropOutputs(self._number, self._phase != "stop", self._phase, failure)

    def _record_landing(self, rig: RigReadings) -> str:
        self._restart_run()
        if rig.plate_before:
            return "the plate was touched before the shaft turned"
        if rig.turned_before:
            return "the shaft turned before the rig was ready"
        assert rig.drop_s is not None
        self.runs.append(DropRun(abs(rig.shaft_rpm.value), rig.drop_s))
        return ""

    def _restart_run(self) -> None:
        self._phase, self._since_s = "stop", None


def make_drop_table(runs: Iterable[DropRun]) -> str:
    """Returns the runs as a lag bench table (CSV), in the order of measurement."""
    rows = [
        f"{run.shaft_rpm:.1f},{number},{run.drop_s:.3f}\n"
        for number, run in enumerate(runs, start=1)
    ]
    return "shaft_rpm,replicate,drop_s\n" + "".join(rows)
