"""Defines the guided tour: eight steps on the simulated machine, each finished by performing it;
about a minute.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from topdress.console.app.action import MAP
from topdress.console.frame import Frame
from topdress.console.locale import N_

# From this rate, kg/ha, fertilizer counts as flowing.
MIN_FLOWING_KG_HA = 1.0
# Time to read a step that needs no action, s.
STEP_READING_TIME_S = 8.0


class TourStepInput(NamedTuple):
    """Holds the input of a step. `began` is the frame at which the step began; `lasted_s` is the
    time since then."""

    frame: Frame
    began: Frame
    where: str
    lasted_s: float

    @property
    def state(self) -> str:
        """State of the machine."""
        return self.frame.row.state or ""


class TourStep(NamedTuple):
    """Holds the text of a step and the condition that finishes it."""

    text: str
    done: Callable[[TourStepInput], bool]


TOUR_STEPS = (
    TourStep(
        N_("This machine is simulated: nothing moves outside. Press R to make it ready."),
        # A user who is already ahead does not have to go back.
        lambda seen: seen.state in ("ready", "working", "held"),
    ),
    TourStep(
        N_("Press S: the tractor drives on and fertilizer flows."),
        lambda seen: (
            seen.state == "working"
            and (seen.frame.row.applied_rate_kg_ha or 0.0) > MIN_FLOWING_KG_HA
        ),
    ),
    TourStep(
        N_(
            "The big numbers: target rate and applied rate. Below: speed, shaft, opening, "
            "what is left in the "
            "hopper."
        ),
        lambda seen: seen.lasted_s >= STEP_READING_TIME_S,
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
    """Selects the step to show. The tour gives no order: the operator presses the keys."""

    steps = TOUR_STEPS

    def __init__(self) -> None:
        self.index = 0
        self._began: tuple[Frame, float] | None = None

    @property
    def is_over(self) -> bool:
        """Whether all steps are finished."""
        return self.index >= len(self.steps)

    @property
    def text(self) -> str:
        """Text of the present step, untranslated; "" after the last step."""
        return "" if self.is_over else self.steps[self.index].text

    def follow_frame(self, frame: Frame | None, where: str, now_s: float) -> None:
        """Process a frame, a few times a second, and proceed when the step is finished. `where` is
        the open page."""
        if frame is None or self.is_over:
            return
        if self._began is None:
            self._began = frame, now_s
        began, began_s = self._began
        if self.steps[self.index].done(TourStepInput(frame, began, where, now_s - began_s)):
            self.skip_step()

    def skip_step(self) -> None:
        """Proceed to the next step, whether the present step is finished or not."""
        if not self.is_over:
            self.index += 1
            self._began = None
