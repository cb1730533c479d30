"""The wheel's circumference on the screen: drive straight for 100 m or more, then save."""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app import words
from topdress.console.app.pages.calibrate.calibration import Calibration, FrameSeen
from topdress.console.app.pages.calibrate.catch import TURNING_RPM
from topdress.console.app.pages.calibrate.guide import GuideStep
from topdress.console.app.pages.calibrate.progress_rows import Bar, Line, Row
from topdress.console.app.pages.calibrate.wheel import LEAST_M, WheelRun, WheelSample
from topdress.console.app.view import STALE_S
from topdress.console.app.widgets.chips import Chip
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen

TROUBLES = {
    "bent": N_("Not straight: drive again along a line."),
    "broken": N_("Wheel or GNSS fell silent: begin again."),
}


class WheelCalibration(Calibration):
    kind, name, heading = "wheel", N_("wheel"), N_("Wheel: its circumference by GNSS")

    def __init__(self, page: CalibrateScreen) -> None:
        super().__init__(page, {"cal_begin": lambda _seen: self._begin()})
        self.run = WheelRun()

    def see(self, seen: FrameSeen) -> None:
        frame = seen.frame
        if frame is None:
            return
        row = frame.row
        old = seen.age_s > STALE_S or (frame.gnss_age_s or 0.0) > STALE_S
        known = (
            bool(row.fix_quality)
            and not old
            and None not in (row.lat_deg, row.lon_deg, row.wheel_speed_mps)
        )
        self.run.see(
            WheelSample(
                row.time_s,
                row.lat_deg or 0.0,
                row.lon_deg or 0.0,
                row.fix_quality or 0,
                row.wheel_speed_mps or 0.0,
                (row.shaft_rpm or 0.0) > TURNING_RPM,
            )
            if known
            else None
        )

    def step(self, seen: FrameSeen) -> int:
        if self.run.running:
            return 1
        return 2 if self.fitted is not None else 0

    def steps(self, seen: FrameSeen) -> tuple[GuideStep, ...]:
        enough = self.run.running and self.run.enough
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
                ).format(length=f"{LEAST_M:.0f}"),
            ),
            GuideStep(_("save"), _("E saves the circumference as a new machine file.")),
        )

    def trouble(self, seen: FrameSeen, said: str) -> str:
        return (
            _(TROUBLES[self.run.drive.trouble])
            if self.run.drive.trouble
            else super().trouble(seen, said)
        )

    def found(self) -> tuple[str, ...]:
        rows = super().found()
        return (
            (*rows, _("a cab file has it too: board, wheel_circumference_m"))
            if self.saved
            else rows
        )

    def sheet(self, seen: FrameSeen) -> tuple[Row, ...]:
        drive, distance = self.run.drive, self.page.app.units.fine_distance
        rows: list[Row] = [
            Bar(
                _("driven"),
                round(min(1.0, drive.gnss_m / LEAST_M), 2),
                distance.full(drive.gnss_m),
                "lead" if self.run.running else "",
            ),
            Line(_("by GNSS"), distance.full(drive.gnss_m)),
            Line(_("by wheel"), distance.full(drive.wheel_m)),
            Line(
                _("aside"), distance.full(drive.aside_m), "amber" if drive.trouble == "bent" else ""
            ),
        ]
        if drive.wheel_m > 1.0:
            rows.append(Line(_("GNSS / wheel"), f"{drive.gnss_m / drive.wheel_m:.4f}"))
        fix = seen.frame.row.fix_quality if seen.frame else None
        rows.append(Line(_("fix"), words.name_fix(fix), "" if fix in (4, 5) else "amber"))
        if self.page.service is not None:
            rows.append(Line(_("machine file"), f"{self.page.service.wheel_circumference_m:.4f} m"))
        return tuple(rows)

    def chips(self, seen: FrameSeen) -> tuple[Chip, ...]:
        label = _("end") if self.run.running else _("begin")
        return (
            Chip(
                "cal_begin",
                "B",
                label,
                seen.frame is not None,
                lead=self.step(seen) == 0 or (self.run.enough and self.run.running),
            ),
            self.save_chip(),
        )

    def _begin(self) -> None:
        if not self.run.running:
            self.run.start()
            self.forget()
            return
        self.run.stop()
        service, samples = self.page.service, tuple(self.run.samples)
        if self.run.enough and service is not None:
            self.page.compute(lambda: service.fit_wheel(samples), self.take)
        elif not self.run.enough and not self.run.drive.trouble:
            self.page.app.notice(
                _("too short: {length} m or more are needed").format(length=f"{LEAST_M:.0f}")
            )
