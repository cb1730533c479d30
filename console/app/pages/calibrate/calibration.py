"""Defines the base classes of the calibrations on the Calibrate screen."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from topdress.console.app import frame_words
from topdress.console.app.pages.calibrate.curve_plot import CurveView
from topdress.console.app.pages.calibrate.guide_panel import GuideStep, GuideView
from topdress.console.app.pages.calibrate.progress_rows import ProgressRow
from topdress.console.app.pages.calibrate.service import CalibrationResult, Estimate
from topdress.console.app.widgets.action_chips import ActionChip
from topdress.console.frame import Frame
from topdress.console.locale import N_, _
from topdress.control.orders import Order

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen

# Words for the parameters that a calibration estimates, by their names in the machine file.
ESTIMATE_NAMES = {
    "grams_per_rev_mm": N_("flow"),
    "zero_offset": N_("at zero opening"),
    "fill_falloff": N_("lost at 100 r/min"),
    "slope": N_("slope"),
    "intercept": N_("at 0 r/min"),
    "circumference": N_("circumference"),
    "carried_share": N_("carried along"),
    "coulomb": N_("shaft, dry"),
    "coulomb_back": N_("shaft backwards, dry"),
    "viscous": N_("shaft, with its speed"),
    "viscous_back": N_("shaft backwards, with its speed"),
    "load": N_("shaft, with the material"),
    "gate_coulomb": N_("gate, dry"),
    "gate_coulomb_back": N_("gate backwards, dry"),
    "gate_viscous": N_("gate, with its speed"),
    "gate_viscous_back": N_("gate backwards, with its speed"),
}
# Units as `control` names them, in the words of the screen.
UNIT_NAMES = {
    "g/rev/mm": N_("g per turn and mm"),
    "g/rev": N_("g per turn"),
    "s per r/min": N_("s per r/min"),
}
# Axes as `control.calibration` names them, in the words of the screen.
AXIS_NAMES = {
    "opening mm": N_("opening, mm"),
    "shaft r/min": N_("shaft, r/min"),
    "g per turn": N_("g per turn"),
    "lag s": N_("lag, s"),
}


class FrameWithAge(NamedTuple):
    """Holds the newest frame, its age in s, and the console's clock in s."""

    frame: Frame | None
    age_s: float
    now_s: float

    @property
    def state(self) -> str:
        """State of the machine, "" where unknown."""
        return (self.frame.row.state or "") if self.frame else ""

    @property
    def is_calibrating(self) -> bool:
        """Whether a calibration run is in progress."""
        return self.state == "calibrating"

    @property
    def is_ready(self) -> bool:
        """Whether the machine is ready or calibrating."""
        return self.state in ("ready", "calibrating")


KeyAction = Callable[[FrameWithAge], object]


class Calibration:
    """Guides through the steps of a calibration: text of each step, step to do now, result.

    Attributes
    ----------
    kind
        Word in the names of the machine files that it saves.
    name, heading
        Untranslated words for the screen.
    holds
        True if the calibration has a run that lasts while a key is held.
    deeds
        Functions of the keys, by action. A key without function belongs to another calibration.
    """

    kind = name = heading = ""
    holds = False

    def __init__(self, page: CalibrateScreen, deeds: Mapping[str, KeyAction]) -> None:
        self.page, self.key_actions = page, deeds
        self.fitted: CalibrationResult | None = None
        self.saved = ""

    def take_frame(self, seen: FrameWithAge) -> None:
        """Process a new frame."""

    def list_set_points(self) -> Sequence[Order]:
        """Return the orders for shaft and gate at the beginning of a held run."""
        return ()

    def list_steps(self, seen: FrameWithAge) -> tuple[GuideStep, ...]:
        """Return the steps of the guide."""
        raise NotImplementedError

    def find_step(self, seen: FrameWithAge) -> int:
        """Return the index of the step to do now."""
        raise NotImplementedError

    def make_guide(self, seen: FrameWithAge, said: str) -> GuideView:
        """Return the guide for the screen."""
        return GuideView(
            _(self.heading),
            self.list_steps(seen),
            self.find_step(seen),
            self.explain_standstill(seen, said),
            self.describe_result(),
        )

    def explain_standstill(self, seen: FrameWithAge, said: str) -> str:
        """Return why the calibration does not proceed, in words; `said` is the worker's refusal."""
        return "" if seen.frame is not None else _("No machine is connected.")

    def list_progress_rows(self, seen: FrameWithAge) -> tuple[ProgressRow, ...]:
        """Return the rows of the measurement in progress."""
        return ()

    def make_curve(self) -> CurveView | None:
        """Return the measured curve, or None without a curve."""
        return None

    def list_chips(self, seen: FrameWithAge) -> tuple[ActionChip, ...]:
        """Return the keys of this calibration, with those that can be pressed now."""
        raise NotImplementedError

    def take_result(self, fitted: CalibrationResult) -> None:
        """Adopt a new result, which is not saved yet."""
        self.fitted, self.saved = fitted, ""

    def forget_result(self) -> None:
        """Drop the result, because it no longer belongs to the measurement."""
        self.fitted, self.saved = None, ""

    def describe_result(self) -> tuple[str, ...]:
        """Return the result in words."""
        if self.fitted is None:
            return ()
        # The estimates come with their intervals, so that a poor test is recognisable.
        rows = [format_estimate(one) for one in self.fitted.estimates]
        if self.fitted.scatter:
            rows.append(_("scatter {scatter}").format(scatter=self.fitted.scatter))
        # A range of (0, 0) means that the result has no range of shaft speed.
        if self.fitted.range != (0.0, 0.0):
            low, high = self.fitted.range
            rows.append(
                _("holds from {low} to {high} r/min").format(low=f"{low:g}", high=f"{high:g}")
            )
        if self.saved:
            rows.append(_("saved: {path}").format(path=shorten_path(self.saved)))
            # The console may run without a job service, so the command line is named.
            rows.append(_("use it with: topdress run --config FILE"))
        return tuple(rows)

    def make_save_chip(self) -> ActionChip:
        """Return the key that saves the result."""
        # A result is saved once.
        on = self.fitted is not None and not self.saved and not self.page.busy
        return ActionChip("cal_save", "E", _("save as new"), on, lead=on)


class HeldRun(Calibration):
    """Guides through a calibration whose shaft turns while a key is held."""

    holds = True

    def explain_standstill(self, seen: FrameWithAge, said: str) -> str:
        """Return why a held run does not proceed: a refusal, or an interlock that stops the
        shaft."""
        if said:
            # A refusal is newer than the frame, so it comes first.
            return said
        frame = seen.frame
        if frame is None:
            return _("No machine is connected.")
        # An interlock can stop the shaft although the key is held.
        if seen.is_calibrating and frame.why_no_flow:
            return _("The shaft may not turn: {why}.").format(
                why=", ".join(frame_words.name_note(note) for note in frame.why_no_flow)
            )
        # The alarm above explains the fault itself.
        if seen.state == "fault":
            return _("The machine is in FAULT: see the alarm above, then make it ready.")
        if seen.state == "ready" and frame.why_state == "calibration_time":
            return _("The run reached its time limit: let go, then press again.")
        return ""


def shorten_path(path: str) -> str:
    """Return a path with the home folder written as ~."""
    home = os.path.expanduser("~")
    return "~" + path.removeprefix(home) if path.startswith(home + os.sep) else path


def format_estimate(one: Estimate) -> str:
    """Return an estimate in the form `flow 5.51 (5.48 to 5.54) g per turn and mm`."""
    name, unit = _(ESTIMATE_NAMES[one.name]), _(UNIT_NAMES.get(one.unit, one.unit))
    # A parameter that the test does not determine is named, instead of being omitted.
    if one.value is None or one.low is None or one.high is None:
        return _("{name}: not shown by this test").format(name=name)
    value, low, high = (f"{number:.{one.decimals}f}" for number in (one.value, one.low, one.high))
    return _("{name} {value} {unit} (90 %: {low} to {high})").format(
        name=name, value=value, unit=unit, low=low, high=high
    )


def make_curve(
    fitted: CalibrationResult | None,
    points: tuple[tuple[float, float], ...],
    x_name: str,
    y_name: str,
) -> CurveView:
    """Return the measured points, with the fitted line where a result exists."""
    if fitted is None:
        return CurveView(_(AXIS_NAMES[x_name]), _(AXIS_NAMES[y_name]), points)
    return CurveView(
        _(AXIS_NAMES[fitted.x_name]),
        _(AXIS_NAMES[fitted.y_name]),
        fitted.points,
        tuple((one.x, one.y, one.low, one.high) for one in fitted.line),
    )
