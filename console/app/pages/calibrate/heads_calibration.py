"""The heads check on the screen: six heads against their median for 30 s of driving."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from statistics import fmean, median
from typing import TYPE_CHECKING, Literal, NamedTuple

from topdress.console.app.pages.calibrate.calibration import Calibration, FrameSeen
from topdress.console.app.pages.calibrate.guide import GuideStep
from topdress.console.app.pages.calibrate.progress_rows import Bar, Level, Line, Middle, Row
from topdress.console.app.widgets.chips import Chip
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen


# The heads check: every canopy head against the median of all, over 30 s of driving.
CHECK_S = 30.0
# of the median: published fouling is 2 to 10 %, heads agree to 0.1 % when clean
FOULED_SHARE = 0.04
# spread (1 s.d.) about the median; a good head has 0.01, the crop itself about as much
UNSTEADY_NDVI = 0.05
# with two heads the median cannot tell which is wrong
LEAST_HEADS = 3
LEAST_SAMPLES = 25
SILENT_SHARE = 0.5  # of the samples

Verdict = Literal["", "good", "fouled", "unsteady", "silent"]


class HeadFound(NamedTuple):
    """One head. offset, spread: NDVI against the median of all; None where it said too little."""

    number: int
    ndvi: float | None
    offset: float | None
    spread: float | None
    verdict: Verdict


class HeadsCheck:
    def __init__(self) -> None:
        self.started_s: float | None = None
        self.seconds = 0.0
        self._apart: list[list[float]] = []
        self._medians: list[float] = []
        self._last: tuple[float | None, ...] = ()

    @property
    def running(self) -> bool:
        return self.started_s is not None and self.seconds < CHECK_S

    @property
    def done(self) -> bool:
        return self.started_s is not None and self.seconds >= CHECK_S

    def start(self, time_s: float) -> None:
        self.started_s, self.seconds = time_s, 0.0
        self._apart, self._medians = [], []

    def see(self, time_s: float, ndvi: Sequence[float | None]) -> None:
        """One frame: NDVI of every head, left to right; None: silent."""
        self._last = tuple(ndvi)
        if not self.running or self.started_s is None:
            return
        self.seconds = max(0.0, time_s - self.started_s)
        while len(self._apart) < len(ndvi):
            self._apart.append([])
        known = [value for value in ndvi if value is not None]
        if len(known) < LEAST_HEADS:
            return
        middle = median(known)
        self._medians.append(middle)
        for apart, value in zip(self._apart, ndvi, strict=False):
            if value is not None:
                apart.append(value - middle)

    def found(self) -> tuple[HeadFound, ...]:
        """What is known of each head so far; verdicts only once the time is over."""
        return tuple(self._head(index) for index in range(len(self._last)))

    def _head(self, index: int) -> HeadFound:
        now = self._last[index]
        apart = self._apart[index] if index < len(self._apart) else []
        if len(apart) < 2:
            return HeadFound(index + 1, now, None, None, "silent" if self.done else "")
        offset = fmean(apart)
        spread = sqrt(fmean((value - offset) ** 2 for value in apart))
        return HeadFound(index + 1, now, offset, spread, self._verdict(len(apart), offset, spread))

    def _verdict(self, count: int, offset: float, spread: float) -> Verdict:
        if not self.done:
            return ""
        if count < max(LEAST_SAMPLES, SILENT_SHARE * len(self._medians)):
            return "silent"
        if spread > UNSTEADY_NDVI:
            return "unsteady"
        certain = 2.0 * spread / sqrt(count)
        return "fouled" if abs(offset) - certain > FOULED_SHARE * fmean(self._medians) else "good"


FULL_NDVI = 0.10  # the bars' ends
VERDICTS = {
    "": "",
    "good": N_("good"),
    "fouled": N_("! FOULED"),
    "unsteady": N_("! UNSTEADY"),
    "silent": N_("✖ SILENT"),
}
ADVICE = {
    "fouled": N_("head {head}: clean it"),
    "unsteady": N_("head {head}: look at its mount and cable"),
    "silent": N_("head {head}: look at its plug and power"),
}
LEVELS: dict[str, Level] = {
    "": "",
    "good": "",
    "fouled": "amber",
    "unsteady": "amber",
    "silent": "red",
}


class HeadsCalibration(Calibration):
    kind, name, heading = "heads", N_("heads check"), N_("Heads check: do all six see the same?")

    def __init__(self, page: CalibrateScreen) -> None:
        super().__init__(page, {"cal_begin": self._begin})
        self.check = HeadsCheck()

    def see(self, seen: FrameSeen) -> None:
        frame = seen.frame
        if frame is not None:
            row = frame.row
            ndvi = frame.head_ndvi or (
                row.ndvi_1,
                row.ndvi_2,
                row.ndvi_3,
                row.ndvi_4,
                row.ndvi_5,
                row.ndvi_6,
            )
            self.check.see(frame.row.time_s, ndvi)

    def step(self, seen: FrameSeen) -> int:
        return 0 if self.check.started_s is None else 1 if self.check.running else 2

    def steps(self, seen: FrameSeen) -> tuple[GuideStep, ...]:
        return (
            GuideStep(
                _("drive"),
                _("Drive over even crop at working speed, heads at their usual height. B begins."),
            ),
            GuideStep(
                _("measure"), _("Drive on for {seconds} s.").format(seconds=f"{CHECK_S:.0f}")
            ),
            GuideStep(
                _("act"),
                _(
                    "Clean the marked heads, then check again with B. A head that still "
                    "reads off goes "
                    "back to the maker."
                ),
            ),
        )

    def found(self) -> tuple[str, ...]:
        if not self.check.done:
            return ()
        advice = tuple(
            _(ADVICE[one.verdict]).format(head=one.number)
            for one in self.check.found()
            if one.verdict in ADVICE
        )
        return advice or (_("all heads agree"),)

    def sheet(self, seen: FrameSeen) -> tuple[Row, ...]:
        check = self.check
        seconds = min(check.seconds, CHECK_S)
        rows: list[Row] = [
            Bar(
                _("time"),
                round(seconds / CHECK_S, 2),
                f"{seconds:4.1f} s",
                "lead" if check.running else "",
            ),
            Line(_("head"), _("NDVI against the median of all: offset, spread")),
        ]
        for one in check.found():
            offset = "--" if one.offset is None else f"{one.offset:+.3f}"
            spread = "--" if one.spread is None else f"{one.spread:.3f}"
            ndvi = "--" if one.ndvi is None else f"{one.ndvi:.2f}"
            share = None if one.offset is None else round(one.offset / FULL_NDVI, 2)
            verdict = _(VERDICTS[one.verdict])
            rows.append(
                Middle(
                    f"{one.number}  {ndvi}",
                    share,
                    f"{offset:>6} {spread:>6} {verdict}".rstrip(),
                    LEVELS[one.verdict],
                )
            )
        return tuple(rows)

    def chips(self, seen: FrameSeen) -> tuple[Chip, ...]:
        label = _("begin again") if self.check.started_s is not None else _("begin")
        return (Chip("cal_begin", "B", label, seen.frame is not None, lead=not self.check.running),)

    def _begin(self, seen: FrameSeen) -> None:
        if seen.frame is not None:
            self.check.start(seen.frame.row.time_s)
