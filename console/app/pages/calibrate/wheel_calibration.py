"""The wheel's circumference on the screen: drive straight for 100 m or more, then save."""
from __future__ import annotations

from console.app import words
from console.app.pages.calibrate.calibration import Bench, Calibration, FrameSeen, mark
from console.app.pages.calibrate.catch import TURNING_RPM
from console.app.pages.calibrate.guide import GuideView, Step
from console.app.pages.calibrate.sheet import Bar, Line, Row
from console.app.pages.calibrate.wheel import LEAST_M, WheelRun, WheelSample
from console.app.view import STALE_S
from console.app.widgets.chips import Chip
from console.locale import N_, _

TROUBLES = {"bent": N_("Not straight: drive again along a line."),
            "broken": N_("Wheel or GNSS fell silent: begin again.")}


class WheelCalibration(Calibration):
    kind = "wheel"

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench)
        self.run = WheelRun()

    def title(self) -> str:
        return _("wheel")

    def see(self, seen: FrameSeen) -> None:
        frame = seen.frame
        if frame is None:
            return
        row = frame.row
        old = seen.age_s > STALE_S or (frame.gnss_age_s or 0.0) > STALE_S
        known = bool(row.fix_quality) and not old and None not in (row.lat_deg, row.lon_deg, row.wheel_speed_mps)
        self.run.see(WheelSample(row.time_s, row.lat_deg or 0.0, row.lon_deg or 0.0, row.fix_quality or 0,
                                 row.wheel_speed_mps or 0.0, (row.shaft_rpm or 0.0) > TURNING_RPM) if known else None)

    def step(self) -> int:
        if self.run.running:
            return 1
        return 2 if self.fitted is not None else 0

    def guide(self, seen: FrameSeen, said: str) -> GuideView:
        now = self.step()
        enough = self.run.running and self.run.enough
        texts = (
            (_("begin"), _("On firm, level ground, tyres at working pressure. B begins; then drive straight.")),
            (_("drive"), _("Enough: B ends it. Driving farther makes it more accurate.") if enough else
             _("Drive straight at a steady speed for {length} m or more. Then B ends it.").format(
                 length=f"{LEAST_M:.0f}")),
            (_("save"), _("E saves the circumference as a new machine file.")))
        trouble = _(TROUBLES[self.run.drive.trouble]) if self.run.drive.trouble else ""
        return GuideView(_("Wheel: its circumference by GNSS"),
                         tuple(Step(mark(index, now), title, text) for index, (title, text) in enumerate(texts)),
                         trouble or ("" if seen.frame is not None else _("No control worker is connected.")),
                         self.found())

    def found(self) -> tuple[str, ...]:
        rows = super().found()
        return (*rows, _("a cab file has it too: board, wheel_circumference_m")) if self.saved else rows

    def sheet(self, seen: FrameSeen) -> tuple[Row, ...]:
        drive, distance = self.run.drive, self.bench.units.fine_distance
        rows: list[Row] = [
            Bar(_("driven"), round(min(1.0, drive.gnss_m / LEAST_M), 2), distance.full(drive.gnss_m),
                "lead" if self.run.running else ""),
            Line(_("by GNSS"), distance.full(drive.gnss_m)), Line(_("by wheel"), distance.full(drive.wheel_m)),
            Line(_("aside"), distance.full(drive.aside_m), "amber" if drive.trouble == "bent" else "")]
        if drive.wheel_m > 1.0:
            rows.append(Line(_("GNSS / wheel"), f"{drive.gnss_m / drive.wheel_m:.4f}"))
        fix = seen.frame.row.fix_quality if seen.frame else None
        rows.append(Line(_("fix"), words.fix_word(fix), "" if fix in (4, 5) else "amber"))
        job = self.bench.job
        if job is not None:
            rows.append(Line(_("machine file"), f"{job.wheel_circumference_m:.4f} m"))
        return tuple(rows)

    def chips(self, seen: FrameSeen) -> tuple[Chip, ...]:
        label = _("end") if self.run.running else _("begin")
        return (Chip("cal_begin", "B", label, seen.frame is not None, lead=self.step() == 0 or (self.run.enough
                     and self.run.running)), self.save_chip())

    def begin(self, seen: FrameSeen) -> None:
        if not self.run.running:
            self.run.start()
            self.forget()
            return
        self.run.stop()
        if self.run.enough:
            self._compute()
        elif not self.run.drive.trouble:
            self.bench.tell(_("too short: {length} m or more are needed").format(length=f"{LEAST_M:.0f}"))

    def _compute(self) -> None:
        job, samples = self.bench.job, tuple(self.run.samples)
        if job is not None:
            self.bench.compute(lambda: job.fit_wheel(samples), self.take)
