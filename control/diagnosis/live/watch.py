"""A log that is still being written, looked at every half minute: since when does the machine
depart from its model?

Two things may say so. The sequential test (`rolling.py`) says that something has started; a
full diagnosis of the stretch around it must then agree. And full diagnoses of quarters of an
hour find what was there from the start or grew too slowly; two in a row, which share no row,
must say the same. While nothing stands, the first of such two is diagnosed only once the second
says something: alone it says nothing. Pure: rows come in, what stands comes out; whoever calls
decides when.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import ROWS
from topdress.control.diagnosis.extend import not_adoptable
from topdress.control.diagnosis.result import UNKNOWN, Cause, Departure, Diagnosis
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.diagnosis.runs.model import GROUPS
from topdress.control.machine.machine import Machine

from .rolling import BAR, ChangePoint, Rolling, Rows

Columns = Mapping[str, npt.NDArray[Any]]
Array = npt.NDArray[Any]

LOOK_S = 30.0  # of the log, between two looks
# between two full diagnoses, and what each is about
QUARTER_S = 900.0
FIRST_S = 300.0  # of the log, before which nothing can be said
BEFORE_S = 600.0  # of a beginning, that its diagnosis sees
# of a stretch that is diagnosed: what is kept of the log, and a quarter of an hour more
MOST_S = 1800.0
# kept at most, 50 MB: so much at up to 44 rows a second, whatever their times say
MOST_ROWS = 120_000
# what a diagnosis did not bear out or name is diagnosed again at every second look
AGAIN_S = 1.5 * LOOK_S

_GROUP_OF = {channel: group for group, names in GROUPS.items() for channel in names} | {
    "flow": "metering"
}


class _Quarter(NamedTuple):
    """A quarter of an hour that was not diagnosed yet."""

    begin_s: float
    end_s: float


class LiveCheck:
    """Rows in, departures out. `standing`: what departs now, None where nothing does."""

    def __init__(
        self,
        machine: Machine,
        test: Callable[[Rows, float], list[ChangePoint]] | None = None,
        diagnose: Callable[[Columns, Machine], Diagnosis] = diagnose_run,
    ) -> None:
        self._machine, self._test, self._diagnose = machine, test or Rolling(machine), diagnose
        # when a beginning was diagnosed last, by group ...
        self._asked: dict[str, float] = {}
        self._nameless: dict[str, float] = {}  # ... and when one that has no name
        self._rows: deque[dict[str, Array]] = deque()  # pieces as they came
        self._kept = 0  # rows in them
        self._begin_s: float | None = None
        self._looked_s = self._diagnosed_s = self._reported_s = 0.0
        self._last: Departure | _Quarter | None = None  # of the quarter before
        self.standing: Departure | None = None
        self.diagnoses = 0

    @property
    def now_s(self) -> float:
        """Time of the newest row."""
        return float(self._rows[-1]["time_s"][-1]) if self._rows else 0.0

    def add(self, rows: Columns) -> None:
        """Rows that follow those added before; columns as of `diagnose_run`. What is too old is
        forgotten."""
        if not len(rows["time_s"]):
            return
        if self._begin_s is None:
            self._begin_s = self._looked_s = self._diagnosed_s = float(rows["time_s"][0])
        # copies: what comes is a piece of a reader's larger tables, which would be kept with it
        self._rows.append({name: np.array(array[-MOST_ROWS:]) for name, array in rows.items()})
        self._kept += len(self._rows[-1]["time_s"])
        while (
            self._rows[0]["time_s"][-1] < self.now_s - MOST_S - QUARTER_S or self._kept > MOST_ROWS
        ):
            self._kept -= len(self._rows.popleft()["time_s"])

    @property
    def due(self) -> bool:
        """Whether a look may find something new."""
        return (
            self._begin_s is not None
            and self.now_s - self._begin_s >= FIRST_S
            and self.now_s - self._looked_s >= LOOK_S
        )

    def look(self) -> Departure | None:
        """What stands after a look at the newest rows. Never raises for what is in them."""
        self._looked_s = self.now_s
        if self.now_s - self._diagnosed_s >= QUARTER_S:
            self._diagnose_quarter()
        elif _is_mostly_working(self._select_rows_since(self.now_s - LOOK_S)):
            self._name_departure()
            self._test_sequentially()
        return self.standing

    def _name_departure(self) -> None:
        """A name for what began and has none yet."""
        found = self.standing
        if (
            found is None
            or found.cause
            or found.since_s is None
            or self.now_s - self._reported_s < AGAIN_S
        ):
            return
        departure = self._departure(found.since_s - BEFORE_S, _GROUP_OF.get(found.channel))
        if departure is not None and departure.cause:
            self.standing = _add_begin_time(departure, found.since_s)

    def _test_sequentially(self) -> None:
        try:
            found = self._test(self._select_rows_since, self.now_s)
        except ValueError:  # too few rows of anything
            return
        said = None if self.standing is None else _GROUP_OF.get(self.standing.channel)
        new = [
            one
            for one in found
            if one.evidence > BAR
            and one.group != said
            and self.now_s - self._asked.get(one.group, -np.inf) >= AGAIN_S
        ]
        if not new:
            return
        first = max(new, key=lambda one: one.evidence)
        self._asked[first.group] = self.now_s
        onset_s = self.now_s if first.part.onset_s is None else first.part.onset_s
        departure = self._departure(onset_s - BEFORE_S, first.group)
        if departure is None or not _is_confirmed_by(first, departure):
            return
        seen_s = self._nameless.get(first.group, -np.inf)
        if departure.cause:
            self.standing = _add_begin_time(departure, onset_s)
        # what has no name must be seen twice, as a moment's noise has none
        elif self.now_s - seen_s >= QUARTER_S:
            self._nameless[first.group] = self.now_s
        # either: the second time in rows of its own
        elif self._departure(seen_s, first.group) is not None:
            self.standing = _add_begin_time(departure, onset_s)

    def _diagnose_quarter(self) -> None:
        this, self._diagnosed_s = _Quarter(self._diagnosed_s, self.now_s), self.now_s
        if self.standing is None and self._last is None:
            self._last = this  # whatever it says, it says nothing alone
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
            self.standing = None  # gone for half an hour: repaired, or never there
        self._last = departure

    def _describe_stretch(self, stretch: _Quarter) -> Departure | None:
        return self._departure(stretch.begin_s, None, stretch.end_s)

    def _departure(
        self, begin_s: float, group: str | None, end_s: float = np.inf
    ) -> Departure | None:
        """What a full diagnosis says of a stretch of the log, about one group or all; times of
        the log."""
        self.diagnoses += 1
        self._reported_s = self.now_s
        rows = self._select_rows_since(max(begin_s, min(self.now_s, end_s) - MOST_S), end_s)
        try:
            found = find_departure(self._diagnose(rows, self._machine), group)
        except ValueError:
            return None
        if found is None or found.since_s is None:
            return found
        # counted from its first row
        return found._replace(since_s=found.since_s + float(rows["time_s"][0]))

    def _select_rows_since(self, begin_s: float, end_s: float = np.inf) -> dict[str, Array]:
        """Columns of the rows from a time to another."""
        pieces = [
            piece
            for piece in self._rows
            if piece["time_s"][-1] >= begin_s and piece["time_s"][0] <= end_s
        ]
        rows = _join_columns(pieces or [self._rows[-1]])
        inside = (rows["time_s"] >= begin_s) & (rows["time_s"] <= end_s)
        return rows if inside.all() else {name: array[inside] for name, array in rows.items()}


def find_departure(found: Diagnosis, group: str | None = None) -> Departure | None:
    """What a diagnosis says, in one: its costliest cause that is no mere suspicion and has not
    ended; else what it cannot explain.

    group: only of these channels. Times are from the first row that was diagnosed.
    """
    for cause in found.causes:
        if (
            (group is None or _GROUP_OF[ROWS[cause.id].channels[0]] == group)
            and cause.until_s is None
            and not any(rival.id == UNKNOWN for rival in cause.rivals)
        ):
            return _make_departure_of_cause(cause, found)
    for left in found.unexplained:
        if group is None or _GROUP_OF.get(left.channel) == group:
            return Departure(left.channel, "", left.dose_percent, left.from_s, False)
    return None


# one looks like the other until a catch test, or a known load
BY_THE_SCALE_ALONE = ("flow.gain", "scale.gain")


def _make_departure_of_cause(cause: Cause, found: Diagnosis) -> Departure:
    percent = cause.field_cost.rate_error_percent
    return Departure(
        ROWS[cause.id].channels[0] if ROWS[cause.id].stage != "flow" else "flow",
        cause.id,
        percent or None,
        cause.onset_s,
        not cause.rivals,
        not not_adoptable(cause) and not cause.rivals and cause.id not in BY_THE_SCALE_ALONE,
        found.next_run.plan if cause.rivals and found.next_run is not None else "",
        cause.size.value,
        cause.size.unit,
    )


def _is_confirmed_by(change: ChangePoint, found: Departure) -> bool:
    """Whether a diagnosis agrees that something began: it dates it, names the same effect, or
    has no name for it.

    What it finds all along under another name did not begin then; two quarters of an hour may
    say it.
    """
    return found.since_s is not None or found.cause in ("", change.part.id)


def _add_begin_time(found: Departure, since_s: float) -> Departure:
    """With the time from which on it is seen, where the diagnosis itself does not say."""
    return found if found.since_s is not None else found._replace(since_s=since_s)


def _is_same_departure(one: Departure, other: Departure) -> bool:
    """The same name; or, of what has none, the same channel."""
    return one.channel == other.channel and (
        one.cause == other.cause or not one.certain or not other.certain
    )


def _is_mostly_working(rows: Columns) -> bool:
    """Whether the machine worked for most of these rows, as far as they say."""
    state = rows.get("state")
    if state is not None and np.any(state != ""):
        return bool(np.mean(state == "working") > 0.5)
    return True


def _join_columns(pieces: Sequence[Columns]) -> dict[str, Array]:
    """One after the other; where a piece lacks a column, its cells are empty."""
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
