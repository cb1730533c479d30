"""Checks a growing log every half minute: since when does the machine deviate from its model?

Two methods detect a deviation. The sequential test (`sequential_test.py`) detects an onset; a full
diagnosis of the stretch around the onset must then agree. Full diagnoses of quarters of an hour
detect effects that were present from the start or grew too slowly; two consecutive quarters, which
share no row, must agree. While no deviation stands, the first quarter of a pair is diagnosed only
after the second reports something, because alone it decides nothing. The module is pure: rows come
in, the standing deviation comes out; the caller decides when.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.extend import find_cause_refusal
from topdress.control.diagnosis.result import UNKNOWN, Cause, Diagnosis, ModelDeviation
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.diagnosis.runs.model import CHANNEL_GROUPS
from topdress.control.machine.machine import Machine

from .sequential_test import ALARM_THRESHOLD, ChangePoint, RowReader, SequentialTest

Columns = Mapping[str, npt.NDArray[Any]]
Array = npt.NDArray[Any]

# Time between two checks, in log time, s.
CHECK_INTERVAL_S = 30.0
# Time between two full diagnoses, and length of the stretch of each, s.
DIAGNOSIS_INTERVAL_S = 900.0
# Minimum length of the log for a check, s.
MIN_LOG_S = 300.0
# Time before an onset that its diagnosis includes, s.
ONSET_LEAD_S = 600.0
# Maximum length of a diagnosed stretch, s; a quarter of an hour more is stored.
MAX_STRETCH_S = 1800.0
# Maximum number of stored rows, 50 MB: sufficient for 44 rows a second, and a bound when times are
# wrong.
MAX_STORED_ROWS = 120_000
# Time until an unconfirmed or unnamed onset is diagnosed again, s: every second check.
RETRY_INTERVAL_S = 1.5 * CHECK_INTERVAL_S

_CHANNEL_GROUP = {
    channel: group for group, names in CHANNEL_GROUPS.items() for channel in names
} | {"flow": "metering"}


class _Quarter(NamedTuple):
    """A quarter of an hour that was not diagnosed yet."""

    begin_s: float
    end_s: float


class LiveCheck:
    """Live check: receives rows and returns deviations. `standing`: the current deviation, None
    where there is none."""

    def __init__(
        self,
        machine: Machine,
        test: Callable[[RowReader, float], list[ChangePoint]] | None = None,
        diagnose: Callable[[Columns, Machine], Diagnosis] = diagnose_run,
    ) -> None:
        self._machine, self._test, self._diagnose = (
            machine,
            test or SequentialTest(machine),
            diagnose,
        )
        # Time of the last diagnosis of an onset, by group.
        self._asked: dict[str, float] = {}
        # Time of the last diagnosis of an unnamed onset, by group.
        self._nameless: dict[str, float] = {}
        # Received pieces of rows.
        self._rows: deque[dict[str, Array]] = deque()
        # Number of rows in the pieces.
        self._kept = 0
        self._begin_s: float | None = None
        self._looked_s = self._diagnosed_s = self._reported_s = 0.0
        # Result of the quarter before, or the quarter itself while not diagnosed.
        self._last: ModelDeviation | _Quarter | None = None
        self.standing: ModelDeviation | None = None
        self.diagnoses = 0

    @property
    def now_s(self) -> float:
        """Time of the newest row, s."""
        return float(self._rows[-1]["time_s"][-1]) if self._rows else 0.0

    def add_rows(self, rows: Columns) -> None:
        """Add rows that follow the earlier rows; columns as of `diagnose_run`. Old rows are
        removed."""
        if not len(rows["time_s"]):
            return
        if self._begin_s is None:
            self._begin_s = self._looked_s = self._diagnosed_s = float(rows["time_s"][0])
        # The rows are copied, because a view would keep the reader's larger tables in memory.
        self._rows.append(
            {name: np.array(array[-MAX_STORED_ROWS:]) for name, array in rows.items()}
        )
        self._kept += len(self._rows[-1]["time_s"])
        while (
            self._rows[0]["time_s"][-1] < self.now_s - MAX_STRETCH_S - DIAGNOSIS_INTERVAL_S
            or self._kept > MAX_STORED_ROWS
        ):
            self._kept -= len(self._rows.popleft()["time_s"])

    @property
    def is_due(self) -> bool:
        """Tell whether a check may find something new."""
        return (
            self._begin_s is not None
            and self.now_s - self._begin_s >= MIN_LOG_S
            and self.now_s - self._looked_s >= CHECK_INTERVAL_S
        )

    def check_rows(self) -> ModelDeviation | None:
        """Check the newest rows and return the standing deviation. The method never raises because
        of their content."""
        self._looked_s = self.now_s
        if self.now_s - self._diagnosed_s >= DIAGNOSIS_INTERVAL_S:
            self._diagnose_quarter()
        elif _is_mostly_working(self._select_rows_since(self.now_s - CHECK_INTERVAL_S)):
            self._name_departure()
            self._test_sequentially()
        return self.standing

    def _name_departure(self) -> None:
        """Diagnose an onset that has no name yet."""
        found = self.standing
        if (
            found is None
            or found.cause
            or found.since_s is None
            or self.now_s - self._reported_s < RETRY_INTERVAL_S
        ):
            return
        departure = self._find_stretch_departure(
            found.since_s - ONSET_LEAD_S, _CHANNEL_GROUP.get(found.channel)
        )
        if departure is not None and departure.cause:
            self.standing = _add_begin_time(departure, found.since_s)

    def _test_sequentially(self) -> None:
        try:
            found = self._test(self._select_rows_since, self.now_s)
        # There are too few rows of every channel.
        except ValueError:
            return
        said = None if self.standing is None else _CHANNEL_GROUP.get(self.standing.channel)
        new = [
            one
            for one in found
            if one.evidence > ALARM_THRESHOLD
            and one.group != said
            and self.now_s - self._asked.get(one.group, -np.inf) >= RETRY_INTERVAL_S
        ]
        if not new:
            return
        first = max(new, key=lambda one: one.evidence)
        self._asked[first.group] = self.now_s
        onset_s = self.now_s if first.part.onset_s is None else first.part.onset_s
        departure = self._find_stretch_departure(onset_s - ONSET_LEAD_S, first.group)
        if departure is None or not _is_confirmed_by(first, departure):
            return
        seen_s = self._nameless.get(first.group, -np.inf)
        if departure.cause:
            self.standing = _add_begin_time(departure, onset_s)
        # An unnamed deviation must be seen twice, because a short disturbance has no name either.
        elif self.now_s - seen_s >= DIAGNOSIS_INTERVAL_S:
            self._nameless[first.group] = self.now_s
        # The second observation must be in rows of its own.
        elif self._find_stretch_departure(seen_s, first.group) is not None:
            self.standing = _add_begin_time(departure, onset_s)

    def _diagnose_quarter(self) -> None:
        this, self._diagnosed_s = _Quarter(self._diagnosed_s, self.now_s), self.now_s
        if self.standing is None and self._last is None:
            # A single quarter decides nothing, whatever its result.
            self._last = this
            return
        departure = self._describe_stretch(this)
        if departure is None and self.standing is None:
            self._last = None
            return
        last = (
            self._describe_stretch(self._last) if isinstance(self._last, _Quarter) else self._last
        )
        if (
            departure is not None
            and self.standing is not None
            and _is_same_departure(departure, self.standing)
        ):
            self.standing = departure._replace(since_s=self.standing.since_s)
        elif departure is not None and last is not None and _is_same_departure(departure, last):
            self.standing = departure._replace(since_s=last.since_s)
        elif departure is None and last is None:
            # The deviation has been absent for half an hour: it was repaired, or never present.
            self.standing = None
        self._last = departure

    def _describe_stretch(self, stretch: _Quarter) -> ModelDeviation | None:
        return self._find_stretch_departure(stretch.begin_s, None, stretch.end_s)

    def _find_stretch_departure(
        self, begin_s: float, group: str | None, end_s: float = np.inf
    ) -> ModelDeviation | None:
        """Return the deviation by a full diagnosis of a stretch of the log, in one group or all;
        times are log times, s."""
        self.diagnoses += 1
        self._reported_s = self.now_s
        rows = self._select_rows_since(max(begin_s, min(self.now_s, end_s) - MAX_STRETCH_S), end_s)
        try:
            found = find_departure(self._diagnose(rows, self._machine), group)
        except ValueError:
            return None
        if found is None or found.since_s is None:
            return found
        # The diagnosis counts times from its first row.
        return found._replace(since_s=found.since_s + float(rows["time_s"][0]))

    def _select_rows_since(self, begin_s: float, end_s: float = np.inf) -> dict[str, Array]:
        """Return the columns of the rows between two times."""
        pieces = [
            piece
            for piece in self._rows
            if piece["time_s"][-1] >= begin_s and piece["time_s"][0] <= end_s
        ]
        rows = _join_columns(pieces or [self._rows[-1]])
        inside = (rows["time_s"] >= begin_s) & (rows["time_s"] <= end_s)
        return rows if inside.all() else {name: array[inside] for name, array in rows.items()}


def find_departure(found: Diagnosis, group: str | None = None) -> ModelDeviation | None:
    """Return the deviation of a diagnosis: its costliest current cause that is not a mere
    suspicion, or else its unexplained structure.

    group: only of these channels. Times are from the first diagnosed row, s.
    """
    for cause in found.causes:
        if (
            (group is None or _CHANNEL_GROUP[EFFECT_ROWS[cause.id].channels[0]] == group)
            and cause.until_s is None
            and not any(rival.id == UNKNOWN for rival in cause.rivals)
        ):
            return _make_departure_of_cause(cause, found)
    for left in found.unexplained:
        if group is None or _CHANNEL_GROUP.get(left.channel) == group:
            return ModelDeviation(left.channel, "", left.dose_percent, left.from_s, False)
    return None


# These effects are confounded until a catch test or a known load.
SCALE_CONFOUNDED_IDS = ("flow.gain", "scale.gain")


def _make_departure_of_cause(cause: Cause, found: Diagnosis) -> ModelDeviation:
    percent = cause.field_cost.rate_error_percent
    return ModelDeviation(
        EFFECT_ROWS[cause.id].channels[0] if EFFECT_ROWS[cause.id].stage != "flow" else "flow",
        cause.id,
        percent or None,
        cause.onset_s,
        not cause.rivals,
        not find_cause_refusal(cause) and not cause.rivals and cause.id not in SCALE_CONFOUNDED_IDS,
        found.next_run.plan if cause.rivals and found.next_run is not None else "",
        cause.size.value,
        cause.size.unit,
    )


def _is_confirmed_by(change: ChangePoint, found: ModelDeviation) -> bool:
    """Tell whether a diagnosis confirms an onset: it finds an onset, names the same effect, or has
    no name for it.

    A permanent effect under another name did not begin then; two quarters of an hour may report it.
    """
    return found.since_s is not None or found.cause in ("", change.part.id)


def _add_begin_time(found: ModelDeviation, since_s: float) -> ModelDeviation:
    """Add the time since which the deviation is observed, where the diagnosis itself has no
    time."""
    return found if found.since_s is not None else found._replace(since_s=since_s)


def _is_same_departure(one: ModelDeviation, other: ModelDeviation) -> bool:
    """Tell whether two deviations have the same name, or, without names, the same channel."""
    return one.channel == other.channel and (
        one.cause == other.cause or not one.certain or not other.certain
    )


def _is_mostly_working(rows: Columns) -> bool:
    """Tell whether the machine worked for most of these rows, as far as they show."""
    state = rows.get("state")
    if state is not None and np.any(state != ""):
        return bool(np.mean(state == "working") > 0.5)
    return True


def _join_columns(pieces: Sequence[Columns]) -> dict[str, Array]:
    """Concatenate pieces; missing columns of a piece become empty cells."""
    found = {}
    for name in dict.fromkeys(name for piece in pieces for name in piece):
        text = any(piece[name].dtype == object for piece in pieces if name in piece)
        empty = "" if text else np.nan
        found[name] = np.concatenate(
            [
                piece[name]
                if name in piece and (piece[name].dtype == object) == text
                else np.full(len(piece["time_s"]), empty, object if text else np.float64)
                for piece in pieces
            ]
        )
    return found
