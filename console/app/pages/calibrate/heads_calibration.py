"""Guides through the heads check: each sensor head is compared with the median of all heads during
30 s of driving.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from statistics import fmean, median
from typing import TYPE_CHECKING, Literal, NamedTuple

from topdress.console.app.pages.calibrate.calibration import Calibration, FrameWithAge
from topdress.console.app.pages.calibrate.guide_panel import GuideStep
from topdress.console.app.pages.calibrate.progress_rows import (
    BarRow,
    LineRow,
    MiddleRow,
    ProgressRow,
    RowLevel,
)
from topdress.console.app.widgets.action_chips import ActionChip
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen


# Duration of the comparison, s.
CHECK_DURATION_S = 30.0
# Offset, as a share of the median, beyond which a head counts as fouled. Published fouling is 2 to
# 10 %; clean heads agree to 0.1 %.
FOULED_OFFSET_SHARE = 0.04
# Standard deviation about the median beyond which a head counts as unsteady; a good head has 0.01,
# and the crop about as much.
MAX_STEADY_SPREAD_NDVI = 0.05
# With two heads the median cannot show which head is wrong.
MIN_HEADS = 3
# A mean of fewer readings has too large a standard error.
MIN_HEAD_SAMPLES = 25
# A head with fewer readings than this share of all samples counts as silent.
MIN_SAMPLE_SHARE = 0.5

HeadVerdict = Literal["", "good", "fouled", "unsteady", "silent"]


class HeadFinding(NamedTuple):
    """Holds the findings on one head: offset and spread of its NDVI against the median of all
    heads. None means too few readings."""

    number: int
    ndvi: float | None
    offset: float | None
    spread: float | None
    verdict: HeadVerdict


class HeadsCheck:
    """Compares each head with the median of all heads for `CHECK_DURATION_S`."""

    def __init__(self) -> None:
        self.started_s: float | None = None
        self.seconds = 0.0
        self._deviations: list[list[float]] = []
        self._medians: list[float] = []
        self._last: tuple[float | None, ...] = ()

    @property
    def is_running(self) -> bool:
        """Whether the check is in progress."""
        return self.started_s is not None and self.seconds < CHECK_DURATION_S

    @property
    def is_done(self) -> bool:
        """Whether the duration has elapsed."""
        return self.started_s is not None and self.seconds >= CHECK_DURATION_S

    def start_check(self, time_s: float) -> None:
        """Start the check at a time of the run, s."""
        self.started_s, self.seconds = time_s, 0.0
        self._deviations, self._medians = [], []

    def add_frame(self, time_s: float, ndvi: Sequence[float | None]) -> None:
        """Add a frame with the NDVI of every head from left to right; None marks a silent head."""
        self._last = tuple(ndvi)
        if not self.is_running or self.started_s is None:
            return
        self.seconds = max(0.0, time_s - self.started_s)
        # The number of heads is known only from the frames.
        while len(self._deviations) < len(ndvi):
            self._deviations.append([])
        known = [value for value in ndvi if value is not None]
        if len(known) < MIN_HEADS:
            return
        # The median is insensitive to one or two faulty heads, unlike the mean.
        middle = median(known)
        self._medians.append(middle)
        for apart, value in zip(self._deviations, ndvi, strict=False):
            if value is not None:
                apart.append(value - middle)

    def list_heads(self) -> tuple[HeadFinding, ...]:
        """Return the findings on each head so far; verdicts exist only after the duration has
        elapsed."""
        return tuple(self._assess_head(index) for index in range(len(self._last)))

    def _assess_head(self, index: int) -> HeadFinding:
        """Return the findings on one head."""
        now = self._last[index]
        apart = self._deviations[index] if index < len(self._deviations) else []
        if len(apart) < 2:
            return HeadFinding(index + 1, now, None, None, "silent" if self.is_done else "")
        offset = fmean(apart)
        spread = sqrt(fmean((value - offset) ** 2 for value in apart))
        return HeadFinding(
            index + 1, now, offset, spread, self._choose_verdict(len(apart), offset, spread)
        )

    def _choose_verdict(self, count: int, offset: float, spread: float) -> HeadVerdict:
        """Return the verdict on a head with `count` readings."""
        if not self.is_done:
            return ""
        if count < max(MIN_HEAD_SAMPLES, MIN_SAMPLE_SHARE * len(self._medians)):
            return "silent"
        if spread > MAX_STEADY_SPREAD_NDVI:
            return "unsteady"
        # Two standard errors of the mean offset are subtracted, so that chance does not make a head
        # "fouled".
        certain = 2.0 * spread / sqrt(count)
        return (
            "fouled"
            if abs(offset) - certain > FOULED_OFFSET_SHARE * fmean(self._medians)
            else "good"
        )


# NDVI at the ends of the bars.
BAR_END_NDVI = 0.10
VERDICT_WORDS = {
    "": "",
    "good": N_("good"),
    "fouled": N_("! FOULED"),
    "unsteady": N_("! UNSTEADY"),
    "silent": N_("✖ SILENT"),
}
ADVICE_TEXTS = {
    "fouled": N_("head {head}: clean it"),
    "unsteady": N_("head {head}: look at its mount and cable"),
    "silent": N_("head {head}: look at its plug and power"),
}
VERDICT_LEVELS: dict[str, RowLevel] = {
    "": "",
    "good": "",
    "fouled": "amber",
    "unsteady": "amber",
    "silent": "red",
}


class HeadsCalibration(Calibration):
    """Guides through the heads check."""

    kind, name, heading = "heads", N_("heads check"), N_("Heads check: do all six see the same?")

    def __init__(self, page: CalibrateScreen) -> None:
        super().__init__(page, {"cal_begin": self._begin_check})
        self.check = HeadsCheck()

    def take_frame(self, seen: FrameWithAge) -> None:
        frame = seen.frame
        if frame is not None:
            row = frame.row
            # A frame of an older worker has no `head_ndvi`; its log row has six heads.
            ndvi = frame.head_ndvi or (
                row.ndvi_1,
                row.ndvi_2,
                row.ndvi_3,
                row.ndvi_4,
                row.ndvi_5,
                row.ndvi_6,
            )
            self.check.add_frame(frame.row.time_s, ndvi)

    def find_step(self, seen: FrameWithAge) -> int:
        return 0 if self.check.started_s is None else 1 if self.check.is_running else 2

    def list_steps(self, seen: FrameWithAge) -> tuple[GuideStep, ...]:
        return (
            GuideStep(
                _("drive"),
                _("Drive over even crop at working speed, heads at their usual height. B begins."),
            ),
            GuideStep(
                _("measure"),
                _("Drive on for {seconds} s.").format(seconds=f"{CHECK_DURATION_S:.0f}"),
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

    def describe_result(self) -> tuple[str, ...]:
        if not self.check.is_done:
            return ()
        advice = tuple(
            _(ADVICE_TEXTS[one.verdict]).format(head=one.number)
            for one in self.check.list_heads()
            if one.verdict in ADVICE_TEXTS
        )
        return advice or (_("all heads agree"),)

    def list_progress_rows(self, seen: FrameWithAge) -> tuple[ProgressRow, ...]:
        check = self.check
        seconds = min(check.seconds, CHECK_DURATION_S)
        rows: list[ProgressRow] = [
            BarRow(
                _("time"),
                round(seconds / CHECK_DURATION_S, 2),
                f"{seconds:4.1f} s",
                "lead" if check.is_running else "",
            ),
            LineRow(_("head"), _("NDVI against the median of all: offset, spread")),
        ]
        for one in check.list_heads():
            offset = "--" if one.offset is None else f"{one.offset:+.3f}"
            spread = "--" if one.spread is None else f"{one.spread:.3f}"
            ndvi = "--" if one.ndvi is None else f"{one.ndvi:.2f}"
            share = None if one.offset is None else round(one.offset / BAR_END_NDVI, 2)
            verdict = _(VERDICT_WORDS[one.verdict])
            rows.append(
                MiddleRow(
                    f"{one.number}  {ndvi}",
                    share,
                    f"{offset:>6} {spread:>6} {verdict}".rstrip(),
                    VERDICT_LEVELS[one.verdict],
                )
            )
        return tuple(rows)

    def list_chips(self, seen: FrameWithAge) -> tuple[ActionChip, ...]:
        label = _("begin again") if self.check.started_s is not None else _("begin")
        return (
            ActionChip(
                "cal_begin", "B", label, seen.frame is not None, lead=not self.check.is_running
            ),
        )

    def _begin_check(self, seen: FrameWithAge) -> None:
        """Start the check."""
        if seen.frame is not None:
            self.check.start_check(seen.frame.row.time_s)
