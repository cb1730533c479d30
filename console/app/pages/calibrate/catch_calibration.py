"""Guides through the catch test on the screen: settle, catch, weigh, at three settings or more;
then fit the flow per revolution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.calibrate.calibration import (
    FrameWithAge,
    HeldRun,
    KeyAction,
    make_curve,
)
from topdress.console.app.pages.calibrate.catch_test import (
    ADVISED_CATCH_S,
    MAX_MODEL_RATIO,
    MIN_CATCHES,
    SETTLING_TIME_S,
    CatchRun,
)
from topdress.console.app.pages.calibrate.curve_plot import CurveView
from topdress.console.app.pages.calibrate.guide_panel import GuideStep
from topdress.console.app.pages.calibrate.progress_rows import (
    BarRow,
    CellsRow,
    LineRow,
    ProgressRow,
)
from topdress.console.app.panel_views import MAX_FRESH_AGE_S
from topdress.console.app.typed_number import format_with_unit, round_inwards
from topdress.console.app.widgets.action_chips import ActionChip
from topdress.console.locale import N_, _
from topdress.control.orders import Do, Order

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen

# Settings closer than this, r/min, count as one setting.
MIN_SPEED_DIFFERENCE_RPM = 1.0
# Openings closer than this, mm, count as one setting.
MIN_OPENING_DIFFERENCE_MM = 0.5
# A released run ends at once, but the shaft still turns while it slows down in state "ready".
BENCH_TEST_STATES = ("calibrating", "ready")


class CatchCalibration(HeldRun):
    """Guides through the catch test."""

    kind, name, heading = "catch", N_("catch test"), N_("Catch test: how much flows per turn")

    def __init__(self, page: CalibrateScreen) -> None:
        super().__init__(
            page,
            {
                # A change of setting during a run would mix two settings in one catch.
                "cal_shaft": self._refuse_while_turning(self._ask_shaft_rpm),
                "cal_opening": self._refuse_while_turning(self._ask_opening_mm),
                "cal_weigh": self._refuse_while_turning(self._ask_weighed_mass),
                "cal_again": self._refuse_while_turning(lambda: self.test.settle_again()),
                "cal_undo": lambda _seen: self._undo_point(),
                "cal_fit": lambda _seen: self._fit_flow_model(),
            },
        )
        # Without a service, as in pictures, usual values replace the machine's working point.
        service = page.service
        self.test = CatchRun(
            service.set_shaft_rpm if service else 50.0, service.set_opening_mm if service else 25.0
        )

    def take_frame(self, seen: FrameWithAge) -> None:
        frame = seen.frame
        if frame is None:
            return
        # Revolutions while working must not count as a catch.
        if frame.row.state not in BENCH_TEST_STATES:
            self.test.pause_counting()
        else:
            self.test.add_frame(
                frame.row.time_s,
                frame.row.shaft_rpm,
                frame.row.opening_mm,
                frame.row.hopper_kg,
                seen.is_calibrating,
            )

    def list_set_points(self) -> Sequence[Order]:
        # The gate moves before the shaft turns, so that the first material already flows through
        # the new opening.
        return (
            Order(Do.CALIBRATE_OPENING, self.test.opening_mm),
            Order(Do.CALIBRATE_SHAFT, self.test.shaft_rpm),
        )

    def find_step(self, seen: FrameWithAge) -> int:
        test = self.test
        if self.fitted is not None or (
            len(test.points) >= MIN_CATCHES
            and test.shaft_turns.revolutions == 0.0
            and not seen.is_calibrating
        ):
            return 4
        # The steps follow the state of the machine, so that the guide is right after an
        # interruption.
        if not seen.is_ready:
            return 0
        if test.phase == "settle":
            return 1
        return 3 if test.can_weigh and not seen.is_calibrating else 2

    def list_steps(self, seen: FrameWithAge) -> tuple[GuideStep, ...]:
        # The guide counts down the catches that are still needed.
        rest = max(0, MIN_CATCHES - len(self.test.points))
        return (
            GuideStep(
                _("make ready"),
                _("The tractor stands still. R makes the machine ready; nothing turns yet."),
            ),
            GuideStep(
                _("settle"),
                _("Enough: let go of I.")
                if self.test.shaft_turns.seconds >= SETTLING_TIME_S
                else _(
                    "A vessel under the outlets. Hold I until the bar is full; what fell is "
                    "put back."
                ),
            ),
            GuideStep(
                _("catch"),
                _("Enough: let go of I.")
                if self.test.shaft_turns.seconds >= ADVISED_CATCH_S
                else _(
                    "Empty vessels of known weight under all outlets. Hold I for about "
                    "{seconds} s, then let go."
                ).format(seconds=f"{ADVISED_CATCH_S:.0f}"),
            ),
            GuideStep(
                _("weigh"),
                _("Q3: type what all outlets together gave. If in doubt, Q4 settles again."),
            ),
            GuideStep(
                _("fit and save"),
                _("Q5 fits the curve. More settings make it better: Q1 and Q2 change them.")
                if not rest
                else _(
                    "{rest} more catches: change the setting with Q1 or Q2, for a wide range."
                ).format(rest=rest),
            ),
        )

    def list_progress_rows(self, seen: FrameWithAge) -> tuple[ProgressRow, ...]:
        test, row = self.test, seen.frame.row if seen.frame else None
        old = seen.age_s > MAX_FRESH_AGE_S or row is None
        shaft = "--" if row is None or row.shaft_rpm is None else f"{row.shaft_rpm:.1f}"
        opening = "--" if row is None or row.opening_mm is None else f"{row.opening_mm:.1f}"
        # One bar belongs to each phase.
        settling = test.phase == "settle"
        seconds, turns = test.shaft_turns.seconds, test.shaft_turns.revolutions
        settled = 1.0 if not settling else seconds / SETTLING_TIME_S
        caught_s, caught_turns = (0.0, 0.0) if settling else (seconds, turns)
        caught = f"{caught_s:4.1f} s {caught_turns:6.1f} {_('turns')}"
        bars: list[ProgressRow] = [
            LineRow(_("setting"), f"{test.shaft_rpm:g} r/min   {test.opening_mm:g} mm"),
            LineRow(_("measured"), f"{shaft} r/min   {opening} mm", "stale" if old else ""),
            BarRow(
                _("settle"),
                round(settled, 2),
                f"{min(seconds if settling else SETTLING_TIME_S, 99.0):4.1f} s",
                "lead" if settling and seen.is_calibrating else "",
            ),
            BarRow(
                _("catch"),
                round(min(1.0, caught_s / ADVISED_CATCH_S), 2),
                caught,
                "lead" if not settling and seen.is_calibrating else "",
            ),
        ]
        # The scale's loss is a hint only: its noise exceeds that of the vessel's scale.
        says = test.scale_loss_kg
        mass = self.page.app.units.mass._replace(decimals=1)
        bars.append(
            LineRow(
                _("hopper scale"),
                "--"
                if says is None
                else _("about {mass} less").format(mass=mass.format_with_name(says)),
            )
        )
        # A catch is weighed to grams.
        kilograms = self.page.app.units.mass._replace(decimals=3)
        bars.append(
            CellsRow(("r/min", "mm", "s", _("turns"), kilograms.name, _("g/turn")), heading=True)
        )
        bars += [
            CellsRow(
                (
                    f"{one.shaft_rpm:.1f}",
                    f"{one.opening_mm:.1f}",
                    f"{one.duration_s:.1f}",
                    f"{one.revolutions:.1f}",
                    kilograms.format_value(one.mass_kg),
                    f"{one.grams_per_revolution:.1f}",
                )
            )
            for one in test.points
        ]
        return tuple(bars)

    def make_curve(self) -> CurveView:
        points = self.test.points
        speeds = [one.shaft_rpm for one in points]
        openings = [one.opening_mm for one in points]
        # The curve is drawn over the quantity that was varied.
        by_speed = bool(points) and (
            max(openings) - min(openings) < MIN_OPENING_DIFFERENCE_MM
            and max(speeds) - min(speeds) > MIN_SPEED_DIFFERENCE_RPM
        )
        across = speeds if by_speed else openings
        return make_curve(
            self.fitted,
            tuple(zip(across, (one.grams_per_revolution for one in points), strict=True)),
            "shaft r/min" if by_speed else "opening mm",
            "g per turn",
        )

    def list_chips(self, seen: FrameWithAge) -> tuple[ActionChip, ...]:
        test, step, free = self.test, self.find_step(seen), not seen.is_calibrating
        enough = len(test.points) >= MIN_CATCHES
        return (
            ActionChip("cal_ready", "R", _("make ready"), not seen.is_ready, lead=step == 0),
            ActionChip("cal_shaft", "Q1", _("shaft speed"), free),
            ActionChip("cal_opening", "Q2", _("opening"), free),
            ActionChip(
                "cal_run", "I", _("run while held"), seen.is_ready, lead=step in (1, 2), held=True
            ),
            ActionChip("cal_again", "Q4", _("settle again"), free and test.phase == "weigh"),
            ActionChip("cal_weigh", "Q3", _("weighed"), free and test.can_weigh, lead=step == 3),
            ActionChip("cal_undo", "Bksp", _("drop last point"), bool(test.points)),
            ActionChip(
                "cal_fit",
                "Q5",
                _("fit"),
                enough and not self.page.busy,
                lead=step == 4 and self.fitted is None and enough,
            ),
            self.make_save_chip(),
        )

    def _refuse_while_turning(self, do: Callable[[], object]) -> KeyAction:
        """Return a key's action that refuses to run while the shaft turns."""

        def run_if_standing(seen: FrameWithAge) -> None:
            if seen.is_calibrating:
                self.page.app.show_notice(_("let go first: the shaft turns"))
            else:
                do()

        return run_if_standing

    def _ask_shaft_rpm(self) -> None:
        """Ask for the shaft speed, r/min."""
        self.page.ask_question(
            NumberDialog(
                _("Shaft speed"),
                "r/min",
                *self.page.required_service.shaft_rpm,
                _("The shaft turns only while I is held."),
            ),
            lambda shaft_rpm: self.test.change_setting(shaft_rpm=shaft_rpm),
        )

    def _ask_opening_mm(self) -> None:
        """Ask for the opening, mm."""
        self.page.ask_question(
            NumberDialog(_("Opening"), "mm", *self.page.required_service.opening_mm),
            lambda opening_mm: self.test.change_setting(opening_mm=opening_mm),
        )

    def _undo_point(self) -> None:
        """Remove the last catch and the result that contains it."""
        self.test.undo_point()
        self.forget_result()

    def _ask_weighed_mass(self) -> None:
        """Ask for the mass that was caught."""
        if not self.test.can_weigh:
            self.page.app.show_notice(_("nothing is caught yet: hold I first"))
            return
        unit = self.page.app.units.mass
        text = _("{turns} turns in {seconds} s").format(
            turns=f"{self.test.shaft_turns.revolutions:.1f}",
            seconds=f"{self.test.shaft_turns.seconds:.1f}",
        )
        # Rounding inwards keeps the displayed limits within the range in SI units.
        low, high = round_inwards(unit, 0.001, self.page.required_service.most_kg, 3)
        self.page.ask_question(
            NumberDialog(
                _("Weighed, all outlets together"),
                unit.name,
                low,
                high,
                text,
                unit.convert_to_si,
                doubt=self._explain_doubt,
            ),
            self._add_weighed_catch,
        )

    def _explain_doubt(self, mass_kg: float) -> str:
        """Return the objection to a weighed mass: by the hopper scale, or without a scale by the
        machine model."""
        mass = self.page.app.units.mass._replace(decimals=2)
        if self.test.scale_loss_kg is not None:
            return (
                _("The hopper scale lost about {mass}.").format(
                    mass=mass.format_with_name(self.test.scale_loss_kg)
                )
                if self.test.contradicts_scale(mass_kg)
                else ""
            )
        # The machine model catches a wrong decimal point where no scale exists.
        expected_kg = self.test.predict_kg(self.page.required_service.expected_kg)
        if expected_kg <= 0.0 or 1.0 / MAX_MODEL_RATIO <= mass_kg / expected_kg <= MAX_MODEL_RATIO:
            return ""
        return _("By the machine file it would be about {mass}.").format(
            mass=mass.format_with_name(expected_kg)
        )

    def _add_weighed_catch(self, mass_kg: float) -> None:
        # The operator may have started another run while the dialog was open.
        """Add a weighed catch and drop the result, which lacks it."""
        if self.test.can_weigh:
            self.test.add_weighed_catch(mass_kg)
            self.forget_result()
            self.page.app.show_notice(
                _("weighed: {mass}").format(
                    mass=format_with_unit(self.page.app.units.mass, mass_kg)
                )
            )

    def _fit_flow_model(self) -> None:
        """Fit the flow model to the catches, in a thread."""
        service, points = self.page.required_service, tuple(self.test.points)
        if len(points) < MIN_CATCHES:
            self.page.app.show_notice(
                _("{have} of {count} catches done").format(count=MIN_CATCHES, have=len(points))
            )
        else:
            self.page.compute_in_thread(lambda: service.fit_catch(points), self.take_result)
