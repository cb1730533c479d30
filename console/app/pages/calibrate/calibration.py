"""What each calibration of the Calibrate screen is made of."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from topdress.console.app import words
from topdress.console.app.pages.calibrate.curve import CurveView
from topdress.console.app.pages.calibrate.guide import GuideStep, GuideView
from topdress.console.app.pages.calibrate.progress_rows import ProgressRow
from topdress.console.app.pages.calibrate.service import Calibrated, Estimate
from topdress.console.app.widgets.chips import Chip
from topdress.console.frame import Frame
from topdress.console.locale import N_, _
from topdress.control.orders import Order

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen

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
UNIT_NAMES = {
    "g/rev/mm": N_("g per turn and mm"),
    "g/rev": N_("g per turn"),
    "s per r/min": N_("s per r/min"),
}
AXIS_NAMES = {
    "opening mm": N_("opening, mm"),
    "shaft r/min": N_("shaft, r/min"),
    "g per turn": N_("g per turn"),
    "lag s": N_("lag, s"),
}


class FrameSeen(NamedTuple):
    """Holds the newest frame, its age in s, and the console's clock."""

    frame: Frame | None
    age_s: float
    now_s: float

    @property
    def state(self) -> str:
        """State of the machine."""
        return (self.frame.row.state or "") if self.frame else ""

    @property
    def is_calibrating(self) -> bool:
        """Whether a calibrating run goes on."""
        return self.state == "calibrating"

    @property
    def is_ready(self) -> bool:
        """Whether the machine is ready or calibrates."""
        return self.state in ("ready", "calibrating")


KeyAction = Callable[[FrameSeen], object]


class Calibration:
    """Guides through a list of steps: the text of each, which is next, and the result.

    kind: as its machine files are named. name, heading: untranslated. holds: has a run that goes on
    while a key is held. deeds: the functions of its keys, by action; a key without one belongs to
    another calibration.
    """

    kind = name = heading = ""
    holds = False

    def __init__(self, page: CalibrateScreen, deeds: Mapping[str, KeyAction]) -> None:
        self.page, self.deeds = page, deeds
        self.fitted: Calibrated | None = None
        self.saved = ""

    def take_frame(self, seen: FrameSeen) -> None:
        """Take a new frame."""

    def list_set_points(self) -> Sequence[Order]:
        """Orders for shaft and gate at the beginning of a held run."""
        return ()

    def list_steps(self, seen: FrameSeen) -> tuple[GuideStep, ...]:
        """The steps of the guide."""
        raise NotImplementedError

    def find_step(self, seen: FrameSeen) -> int:
        """Index of the step to be done now."""
        raise NotImplementedError

    def make_guide(self, seen: FrameSeen, said: str) -> GuideView:
        """The guide as it is shown."""
        return GuideView(
            _(self.heading),
            self.list_steps(seen),
            self.find_step(seen),
            self.explain_standstill(seen, said),
            self.describe_result(),
        )

    def explain_standstill(self, seen: FrameSeen, said: str) -> str:
        """Why it does not go on, in words; said: a refusal."""
        return "" if seen.frame is not None else _("No machine is connected.")

    def list_progress_rows(self, seen: FrameSeen) -> tuple[ProgressRow, ...]:
        """Rows of the measurement under way."""
        return ()

    def make_curve(self) -> CurveView | None:
        """The measured curve; None without one."""
        return None

    def list_chips(self, seen: FrameSeen) -> tuple[Chip, ...]:
        """The keys that can be pressed now."""
        raise NotImplementedError

    def take_result(self, fitted: Calibrated) -> None:
        """Take a new result, which is not saved yet."""
        self.fitted, self.saved = fitted, ""

    def forget_result(self) -> None:
        """Forget the result, which no longer belongs to the measurement."""
        self.fitted, self.saved = None, ""

    def describe_result(self) -> tuple[str, ...]:
        """The result in words."""
        if self.fitted is None:
            return ()
        rows = [format_estimate(one) for one in self.fitted.estimates]
        if self.fitted.scatter:
            rows.append(_("scatter {scatter}").format(scatter=self.fitted.scatter))
        if self.fitted.range != (0.0, 0.0):
            low, high = self.fitted.range
            rows.append(
                _("holds from {low} to {high} r/min").format(low=f"{low:g}", high=f"{high:g}")
            )
        if self.saved:
            rows.append(_("saved: {path}").format(path=shorten_path(self.saved)))
            rows.append(_("use it with: topdress run --config FILE"))
        return tuple(rows)

    def make_save_chip(self) -> Chip:
        """The key that saves."""
        on = self.fitted is not None and not self.saved and not self.page.busy
        return Chip("cal_save", "E", _("save as new"), on, lead=on)


class HeldRun(Calibration):
    """Guides through a calibration whose shaft turns while a key is held."""

    holds = True

    def explain_standstill(self, seen: FrameSeen, said: str) -> str:
        """Why a held run does not go: a refusal, or an interlock that keeps the shaft still."""
        if said:
            return said
        frame = seen.frame
        if frame is None:
            return _("No machine is connected.")
        if seen.is_calibrating and frame.why_no_flow:
            return _("The shaft may not turn: {why}.").format(
                why=", ".join(words.name_note(note) for note in frame.why_no_flow)
            )
        if seen.state == "fault":
            return _("The machine is in FAULT: see the alarm above, then make it ready.")
        if seen.state == "ready" and frame.why_state == "calibration_time":
            return _("The run reached its time limit: let go, then press again.")
        return ""


def shorten_path(path: str) -> str:
    """The path with the home folder as ~."""
    home = os.path.expanduser("~")
    return "~" + path.removeprefix(home) if path.startswith(home + os.sep) else path


def format_estimate(one: Estimate) -> str:
    """An estimate as `flow 5.51 (5.48 to 5.54) g per turn and mm`."""
    name, unit = _(ESTIMATE_NAMES[one.name]), _(UNIT_NAMES.get(one.unit, one.unit))
    if one.value is None or one.low is None or one.high is None:
        return _("{name}: not shown by this test").format(name=name)
    value, low, high = (f"{number:.{one.decimals}f}" for number in (one.value, one.low, one.high))
    return _("{name} {value} {unit} (90 %: {low} to {high})").format(
        name=name, value=value, unit=unit, low=low, high=high
    )


def make_curve(
    fitted: Calibrated | None, points: tuple[tuple[float, float], ...], x_name: str, y_name: str
) -> CurveView:
    """The measured points, with the fitted line where there is one."""
    if fitted is None:
        return CurveView(_(AXIS_NAMES[x_name]), _(AXIS_NAMES[y_name]), points)
    return CurveView(
        _(AXIS_NAMES[fitted.x_name]),
        _(AXIS_NAMES[fitted.y_name]),
        fitted.points,
        tuple((one.x, one.y, one.low, one.high) for one in fitted.line),
    )
