"""What each calibration of the Calibrate screen is made of."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from topdress.console.app import words
from topdress.console.app.pages.calibrate.curve import CurveView
from topdress.console.app.pages.calibrate.guide import GuideStep, GuideView
from topdress.console.app.pages.calibrate.progress_rows import Row
from topdress.console.app.pages.calibrate.service import Calibrated, Estimate
from topdress.console.app.widgets.chips import Chip
from topdress.console.frame import Frame
from topdress.console.locale import N_, _
from topdress.control.orders import Order

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen

ESTIMATES = {
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
UNIT_WORDS = {
    "g/rev/mm": N_("g per turn and mm"),
    "g/rev": N_("g per turn"),
    "s per r/min": N_("s per r/min"),
}
AXES = {
    "opening mm": N_("opening, mm"),
    "shaft r/min": N_("shaft, r/min"),
    "g per turn": N_("g per turn"),
    "lag s": N_("lag, s"),
}


class FrameSeen(NamedTuple):
    """The newest frame, its age in s, and the console's clock."""

    frame: Frame | None
    age_s: float
    now_s: float

    @property
    def state(self) -> str:
        return (self.frame.row.state or "") if self.frame else ""

    @property
    def calibrating(self) -> bool:
        return self.state == "calibrating"

    @property
    def ready(self) -> bool:
        return self.state in ("ready", "calibrating")


Deed = Callable[[FrameSeen], object]


class Calibration:
    """A list of steps: what is to be done in each, which of them is next, and what was found in
    the end.

    kind: as its machine files are named. name, heading: untranslated. holds: has a run that
    goes on while a key is held. deeds: what its keys do, by action; a key that none has belongs
    to another calibration.
    """

    kind = name = heading = ""
    holds = False

    def __init__(self, page: CalibrateScreen, deeds: Mapping[str, Deed]) -> None:
        self.page, self.deeds = page, deeds
        self.fitted: Calibrated | None = None
        self.saved = ""

    def see(self, seen: FrameSeen) -> None:
        """A new frame has come."""

    def settings(self) -> Sequence[Order]:
        """For shaft and gate at the beginning of a held run."""
        return ()

    def steps(self, seen: FrameSeen) -> tuple[GuideStep, ...]:
        raise NotImplementedError

    def step(self, seen: FrameSeen) -> int:
        """Which of them is to be done now."""
        raise NotImplementedError

    def guide(self, seen: FrameSeen, said: str) -> GuideView:
        return GuideView(
            _(self.heading),
            self.steps(seen),
            self.step(seen),
            self.trouble(seen, said),
            self.found(),
        )

    def trouble(self, seen: FrameSeen, said: str) -> str:
        """Why it does not go on, in words; said: what was refused."""
        return "" if seen.frame is not None else _("No machine is connected.")

    def sheet(self, seen: FrameSeen) -> tuple[Row, ...]:
        return ()

    def curve(self) -> CurveView | None:
        return None

    def chips(self, seen: FrameSeen) -> tuple[Chip, ...]:
        raise NotImplementedError

    def take(self, fitted: Calibrated) -> None:
        self.fitted, self.saved = fitted, ""

    def forget(self) -> None:
        """What was found no longer belongs to what was measured."""
        self.fitted, self.saved = None, ""

    def found(self) -> tuple[str, ...]:
        """The result in words."""
        if self.fitted is None:
            return ()
        rows = [estimate_words(one) for one in self.fitted.estimates]
        if self.fitted.scatter:
            rows.append(_("scatter {scatter}").format(scatter=self.fitted.scatter))
        if self.fitted.range != (0.0, 0.0):
            low, high = self.fitted.range
            rows.append(
                _("holds from {low} to {high} r/min").format(low=f"{low:g}", high=f"{high:g}")
            )
        if self.saved:
            rows.append(_("saved: {path}").format(path=short_path(self.saved)))
            rows.append(_("use it with: topdress run --config FILE"))
        return tuple(rows)

    def save_chip(self) -> Chip:
        on = self.fitted is not None and not self.saved and not self.page.busy
        return Chip("cal_save", "E", _("save as new"), on, lead=on)


class HeldRun(Calibration):
    """One whose shaft turns while a key is held."""

    holds = True

    def trouble(self, seen: FrameSeen, said: str) -> str:
        """Why a held run does not go: what was refused, what keeps the shaft still."""
        if said:
            return said
        frame = seen.frame
        if frame is None:
            return _("No machine is connected.")
        if seen.calibrating and frame.why_no_flow:
            return _("The shaft may not turn: {why}.").format(
                why=", ".join(words.name_note(note) for note in frame.why_no_flow)
            )
        if seen.state == "fault":
            return _("The machine is in FAULT: see the alarm above, then make it ready.")
        if seen.state == "ready" and frame.why_state == "calibration_time":
            return _("The run reached its time limit: let go, then press again.")
        return ""


def short_path(path: str) -> str:
    """The home folder as ~."""
    home = os.path.expanduser("~")
    return "~" + path.removeprefix(home) if path.startswith(home + os.sep) else path


def estimate_words(one: Estimate) -> str:
    """`flow 5.51 (5.48 to 5.54) g per turn and mm`."""
    name, unit = _(ESTIMATES[one.name]), _(UNIT_WORDS.get(one.unit, one.unit))
    if one.value is None or one.low is None or one.high is None:
        return _("{name}: not shown by this test").format(name=name)
    value, low, high = (f"{number:.{one.decimals}f}" for number in (one.value, one.low, one.high))
    return _("{name} {value} {unit} (90 %: {low} to {high})").format(
        name=name, value=value, unit=unit, low=low, high=high
    )


def make_curve(
    fitted: Calibrated | None, points: tuple[tuple[float, float], ...], x_name: str, y_name: str
) -> CurveView:
    """What was measured, with the fitted line where there is one."""
    if fitted is None:
        return CurveView(_(AXES[x_name]), _(AXES[y_name]), points)
    return CurveView(
        _(AXES[fitted.x_name]),
        _(AXES[fitted.y_name]),
        fitted.points,
        tuple((one.x, one.y, one.low, one.high) for one in fitted.line),
    )
