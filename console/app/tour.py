"""The guided tour: eight steps on the simulated machine, each done by doing it; about a minute."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from topdress.console.app.action import MAP
from topdress.console.frame import Frame
from topdress.console.locale import N_

FLOWING_KG_HA = 1.0
READING_S = 8.0  # long enough to read what a step only shows


class TourSeen(NamedTuple):
    """Holds the input of a step. began: the frame with which the step began; lasted_s: since
    then."""

    frame: Frame
    began: Frame
    where: str
    lasted_s: float

    @property
    def state(self) -> str:
        """State of the machine."""
        return self.frame.row.state or ""


class TourStep(NamedTuple):
    """Holds a step: its text and when it is done."""

    text: str
    done: Callable[[TourSeen], bool]


TOUR_STEPS = (
    TourStep(
        N_("This machine is simulated: nothing moves outside. Press R to make it ready."),
        lambda seen: seen.state in ("ready", "working", "held"),
    ),
    TourStep(
        N_("Press S: the tractor drives on and fertilizer flows."),
        lambda seen: (
            seen.state == "working" and (seen.frame.row.applied_rate_kg_ha or 0.0) > FLOWING_KG_HA
        ),
    ),
    TourStep(
        N_(
            "The big numbers: target rate and applied rate. Below: speed, shaft, opening, "
            "what is left in the "
            "hopper."
        ),
        lambda seen: seen.lasted_s >= READING_S,
    ),
    TourStep(
        N_("Press T and choose another strategy: shaft and opening change, the rate does not."),
        lambda seen: seen.frame.row.strategy != seen.began.row.strategy,
    ),
    TourStep(
        N_("Press F3: the map of what was applied, and where."), lambda seen: seen.where == MAP
    ),
    TourStep(
        N_("Press Space: flow stops at once, on every page."), lambda seen: seen.state == "held"
    ),
    TourStep(
        N_("Press F2 for the numbers, then S: work goes on."), lambda seen: seen.state == "working"
    ),
    TourStep(
        N_("Press X: machine off, from any state. F1 explains every key of a page."),
        lambda seen: seen.state == "off",
    ),
)


class Tour:
    """Chooses the step that is shown. It gives no order: the keys pressed are the operator's."""

    steps = TOUR_STEPS

    def __init__(self) -> None:
        self.index = 0
        self._began: tuple[Frame, float] | None = None

    @property
    def is_over(self) -> bool:
        """Whether all steps are done."""
        return self.index >= len(self.steps)

    @property
    def text(self) -> str:
        """The request of the present step, untranslated; empty when the tour is over."""
        return "" if self.is_over else self.steps[self.index].text

    def follow_frame(self, frame: Frame | None, where: str, now_s: float) -> None:
        """Take a frame, some times a second; go on when the step is done. where: the page that is
        open."""
        if frame is None or self.is_over:
            return
        if self._began is None:
            self._began = frame, now_s
        began, began_s = self._began
        if self.steps[self.index].done(TourSeen(frame, began, where, now_s - began_s)):
            self.skip_step()

    def skip_step(self) -> None:
        """Go to the next step, whether this one was done or not."""
        if not self.is_over:
            self.index += 1
            self._began = None
