"""A log that is still being written, looked at every half minute: since when does the machine depart from its model?

Two things may say so. The sequential test (`change.py`) says that something has begun; a full diagnosis of the stretch
around it must then agree. And a full diagnosis of the last quarter of an hour, four times an hour, finds what was there
from the start or grew too slowly; two in a row, which share no row, must say the same. Pure: rows come in, what stands
comes out; whoever calls decides when.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.diagnosis.extend import not_adoptable
from control.diagnosis.result import UNKNOWN, Cause, Diagnosis
from control.diagnosis.runs.diagnose import diagnose_run
from control.diagnosis.runs.model import GROUPS
from control.machine.machine import Machine

from .change import WINDOW_S, Begun, begun
from .departure import Departure

Columns = Mapping[str, npt.NDArray[Any]]
Array = npt.NDArray[Any]

LOOK_S = 30.0               # of the log, between two looks
QUARTER_S = 900.0           # between two full diagnoses, and what each is about
FIRST_S = 300.0             # of the log, before which nothing can be said
BEFORE_S = 600.0            # of a beginning, that its diagnosis sees
MOST_S = 1800.0             # of a stretch that is diagnosed: what is kept of the log
NAMED_AFTER_S = 120.0       # what has no name is diagnosed again when so much more of it is seen
# What a beginning must gain (twice the log-likelihood), by group of channels; benchmarks/live_check.py measures the run
# length that follows. A drive's moves and the heads' contrast are not as Gaussian as level and speeds.
BARS = {"shaft": 40.0, "metering": 40.0, "speed": 30.0, "heads": 40.0}
REFUSED = 1.5               # times the gain that a diagnosis did not bear out: the bar for the next quarter of an hour

_GROUP_OF = {channel: group for group, names in GROUPS.items() for channel in names} | {"flow": "metering"}


class LiveCheck:
    """Rows in, departures out. `standing`: what departs now, None where nothing does."""

    def __init__(self, machine: Machine, test: Callable[[Columns, Machine], list[Begun]] = begun,
                 diagnose: Callable[[Columns, Machine], Diagnosis] = diagnose_run,
                 bars: Mapping[str, float] = BARS) -> None:
        self._machine, self._test, self._diagnose = machine, test, diagnose
        self._bars = dict(bars)
        self._raised: dict[str, float] = {}         # bars until the next quarter of an hour
        self._rows: dict[str, Array] = {}
        self._begin_s: float | None = None
        self._looked_s = self._diagnosed_s = self._told_s = 0.0
        self._last: Departure | None = None         # of the full diagnosis before
        self.standing: Departure | None = None
        self.diagnoses = 0

    @property
    def now_s(self) -> float:
        """Time of the newest row."""
        return float(self._rows["time_s"][-1]) if self._rows else 0.0

    def add(self, rows: Columns) -> None:
        """Rows that follow those added before; columns as of `diagnose_run`. What is too old is forgotten."""
        if not len(rows["time_s"]):
            return
        if self._begin_s is None:
            self._begin_s = self._looked_s = self._diagnosed_s = float(rows["time_s"][0])
        self._rows = _joined(self._rows, rows)
        keep = self._rows["time_s"] > self.now_s - MOST_S
        if not keep.all():
            self._rows = {name: array[keep] for name, array in self._rows.items()}

    @property
    def due(self) -> bool:
        """Whether a look may find something new."""
        return (self._begin_s is not None and self.now_s - self._begin_s >= FIRST_S
                and self.now_s - self._looked_s >= LOOK_S)

    def look(self) -> Departure | None:
        """What stands after a look at the newest rows. Never raises for what is in them."""
        self._looked_s = self.now_s
        if self.now_s - self._diagnosed_s >= QUARTER_S:
            self._quarter()
        elif _works(self._since(self.now_s - LOOK_S)):
            self._named()
            self._sequential()
        return self.standing

    def _named(self) -> None:
        """A name for what began and has none yet."""
        found = self.standing
        if found is None or found.cause or found.since_s is None or self.now_s - self._told_s < NAMED_AFTER_S:
            return
        departure = self._told(found.since_s - BEFORE_S, _GROUP_OF.get(found.channel), found.since_s)
        if departure is not None and departure.cause:
            self.standing = departure

    def _sequential(self) -> None:
        try:
            found = self._test(self._since(self.now_s - WINDOW_S), self._machine)
        except ValueError:              # too few rows of anything
            return
        over = [(one.gain - self._bar(one.group), one) for one in found if one.gain > self._bar(one.group)]
        if not over:
            return
        _, first = max(over, key=lambda each: each[0])
        onset_s = first.part.onset_s or self.now_s
        if self.standing is not None and _GROUP_OF.get(self.standing.channel) == first.group:
            return                      # it is said already
        departure = self._told(onset_s - BEFORE_S, first.group, onset_s)
        if departure is None:
            self._raised[first.group] = REFUSED * first.gain
        else:
            self.standing = departure

    def _bar(self, group: str) -> float:
        return max(self._bars[group], self._raised.get(group, 0.0))

    def _quarter(self) -> None:
        begin_s, self._diagnosed_s = self._diagnosed_s, self.now_s
        self._raised.clear()
        departure = self._told(begin_s, None, None)
        again = departure is not None and self._last is not None and _same(departure, self._last)
        if departure is not None and self.standing is not None and _same(departure, self.standing):
            self.standing = departure._replace(since_s=self.standing.since_s)
        elif again and departure is not None:
            self.standing = departure._replace(since_s=self._last.since_s if self._last else None)
        elif departure is None and self._last is None:
            self.standing = None        # gone for half an hour: repaired, or never there
        self._last = departure

    def _told(self, begin_s: float, group: str | None, onset_s: float | None) -> Departure | None:
        """What a full diagnosis says from a time of the log on, of one group or of all."""
        self.diagnoses += 1
        self._told_s = self.now_s
        try:
            found = self._diagnose(self._since(begin_s), self._machine)
        except ValueError:
            return None
        return departure_of(found, group, onset_s)

    def _since(self, begin_s: float) -> dict[str, Array]:
        rows = self._rows["time_s"] >= begin_s
        return {name: array[rows] for name, array in self._rows.items()}


def departure_of(found: Diagnosis, group: str | None = None, onset_s: float | None = None) -> Departure | None:
    """What a diagnosis says, in one: its costliest cause that is no mere suspicion, else what it cannot explain.

    group: only of these channels. onset_s: when it began, where the diagnosis itself does not say.
    """
    for cause in found.causes:
        if (group is None or _GROUP_OF[ROWS[cause.id].channels[0]] == group) and \
                not any(rival.id == UNKNOWN for rival in cause.rivals):
            return _of_cause(cause, found, onset_s)
    for left in found.unexplained:
        if group is None or _GROUP_OF.get(left.channel) == group:
            return Departure(left.channel, "", left.dose_percent, left.from_s or onset_s, False)
    return None


def _of_cause(cause: Cause, found: Diagnosis, onset_s: float | None) -> Departure:
    percent = cause.field_cost.rate_error_percent
    return Departure(ROWS[cause.id].channels[0] if ROWS[cause.id].stage != "flow" else "flow", cause.id,
                     percent or None, onset_s if cause.onset_s is None else cause.onset_s, not cause.rivals,
                     not not_adoptable(cause) and not cause.rivals,
                     found.next_run.plan if cause.rivals and found.next_run is not None else "",
                     cause.size.value, cause.size.unit)


def _same(one: Departure, other: Departure) -> bool:
    """The same name; or, of what has none, the same channel."""
    return one.channel == other.channel and (one.cause == other.cause or not one.certain or not other.certain)


def _works(rows: Columns) -> bool:
    """Whether the machine worked for most of these rows, as far as they say."""
    state = rows.get("state")
    if state is not None and np.any(state != ""):
        return bool(np.mean(state == "working") > 0.5)
    return True


def _joined(before: Mapping[str, Array], rows: Columns) -> dict[str, Array]:
    if not before:
        return dict(rows)
    found = {}
    for name in {**before, **rows}:
        parts = []
        for part in (before, rows):
            count = len(part["time_s"])
            text = any(name in p and p[name].dtype == object for p in (before, rows))
            empty: Array = np.full(count, "", object) if text else np.full(count, np.nan)
            parts.append(part[name] if name in part and (part[name].dtype == object) == text else empty)
        found[name] = np.concatenate(parts)
    return found
