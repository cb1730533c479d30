"""Guides through the wheel's calibration: drive straight for 100 m or more, then save."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app import frame_words
from topdress.console.app.pages.calibrate.calibration import Calibration, FrameWithAge
from topdress.console.app.pages.calibrate.catch_test import MIN_TURNING_RPM
from topdress.console.app.pages.calibrate.guide_panel import GuideStep
from topdress.console.app.pages.calibrate.progress_rows import BarRow, LineRow, ProgressRow
from topdress.console.app.pages.calibrate.wheel_drive import MIN_DRIVE_M, WheelRun, WheelSample
from topdress.console.app.panel_views import MAX_FRESH_AGE_S
from topdress.console.app.widgets.action_chips import ActionChip
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen

# Words for the faults of `WheelDrive`.
TROUBLE_TEXTS = {
    "bent": N_("Not straight: drive again along a line."),
    "broken": N_("Wheel or GNSS fell silent: begin again."),
}


class WheelCalibration(Calibration):
    """Guides through the wheel's calibration."""

    kind, name, heading = "wheel", N_("wheel"), N_("Wheel: its circumference by GNSS")

    def __init__(self, page: CalibrateScreen) -> None:
        super().__init__(page, {"cal_begin": lambda _seen: self._toggle_drive()})
        self.run = WheelRun()

    def take_frame(self, seen: FrameWithAge) -> None:
        frame = seen.frame
        if frame is None:
            return
        row = frame.row
        # A stale position would shorten the drive by GNSS but not by the wheel.
        old = seen.age_s > MAX_FRESH_AGE_S or (frame.gnss_age_s or 0.0) > MAX_FRESH_AGE_S
        # Wheel and receiver must both be fresh, because the drive compares them.
        known = (
            bool(row.fix_quality)
            and not old
            and None not in (row.lat_deg, row.lon_deg, row.wheel_speed_mps)
        )
        self.run.add_sample(
            WheelSample(
                row.time_s,
                row.lat_deg or 0.0,
                row.lon_deg or 0.0,
                row.fix_quality or 0,
                row.wheel_speed_mps or 0.0,
                # Under load a wheel slips, which the fit must know.
                (row.shaft_rpm or 0.0) > MIN_TURNING_RPM,
            )
            if known
            else None
        )

    def find_step(self, seen: FrameWithAge) -> int:
        # The steps follow the drive, not the machine: no shaft turns here.
        if self.run.running:
            return 1
        return 2 if self.fitted is not None else 0

    def list_steps(self, seen: FrameWithAge) -> tuple[GuideStep, ...]:
        enough = self.run.running and self.run.is_long_enough
        return (
            GuideStep(
                _("begin"),
                _(
                    "On firm, level ground, tyres at working pressure. B begins; then drive "
                    "straight."
                ),
            ),
            GuideStep(
                _("drive"),
                _("Enough: B ends it. Driving farther makes it more accurate.")
                if enough
                else _(
                    "Drive straight at a steady speed for {length} m or more. Then B ends it."
                ).format(length=f"{MIN_DRIVE_M:.0f}"),
            ),
            GuideStep(_("save"), _("E saves the circumference as a new machine file.")),
        )

    def explain_standstill(self, seen: FrameWithAge, said: str) -> str:
        return (
            _(TROUBLE_TEXTS[self.run.drive.trouble])
            if self.run.drive.trouble
            else super().explain_standstill(seen, said)
        )

    def describe_result(self) -> tuple[str, ...]:
        rows = super().describe_result()
        return (
            (*rows, _("a cab file has it too: board, wheel_circumference_m"))
            if self.saved
            else rows
        )

    def list_progress_rows(self, seen: FrameWithAge) -> tuple[ProgressRow, ...]:
        drive, distance = self.run.drive, self.page.app.units.fine_distance
        rows: list[ProgressRow] = [
            BarRow(
                _("driven"),
                round(min(1.0, drive.gnss_m / MIN_DRIVE_M), 2),
                distance.format_with_name(drive.gnss_m),
                "lead" if self.run.running else "",
            ),
            LineRow(_("by GNSS"), distance.format_with_name(drive.gnss_m)),
            LineRow(_("by wheel"), distance.format_with_name(drive.wheel_m)),
            LineRow(
                _("aside"),
                distance.format_with_name(drive.aside_m),
                "amber" if drive.trouble == "bent" else "",
            ),
        ]
        # A ratio of less than a metre is noise.
        if drive.wheel_m > 1.0:
            rows.append(LineRow(_("GNSS / wheel"), f"{drive.gnss_m / drive.wheel_m:.4f}"))
        # Positions without RTK are too inaccurate over 100 m, so their quality is marked.
        fix = seen.frame.row.fix_quality if seen.frame else None
        rows.append(LineRow(_("fix"), frame_words.name_fix(fix), "" if fix in (4, 5) else "amber"))
        if self.page.service is not None:
            rows.append(
                LineRow(_("machine file"), f"{self.page.service.wheel_circumference_m:.4f} m")
            )
        return tuple(rows)

    def list_chips(self, seen: FrameWithAge) -> tuple[ActionChip, ...]:
        label = _("end") if self.run.running else _("begin")
        return (
            ActionChip(
                "cal_begin",
                "B",
                label,
                seen.frame is not None,
                lead=self.find_step(seen) == 0 or (self.run.is_long_enough and self.run.running),
            ),
            self.make_save_chip(),
        )

    def _toggle_drive(self) -> None:
        """Begin a drive, or end it and compute the circumference."""
        if not self.run.running:
            self.run.start_drive()
            self.forget_result()
            return
        self.run.stop_drive()
        # The samples are copied, because the thread reads them while frames arrive.
        service, samples = self.page.service, tuple(self.run.samples)
        if self.run.is_long_enough and service is not None:
            self.page.compute_in_thread(lambda: service.fit_wheel(samples), self.take_result)
        elif not self.run.is_long_enough and not self.run.drive.trouble:
            self.page.app.show_notice(
                _("too short: {length} m or more are needed").format(length=f"{MIN_DRIVE_M:.0f}")
            )
