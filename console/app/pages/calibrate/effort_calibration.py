"""Guides through the reference of effort: the effort that the drives of a sound machine need, from
the log of this run.
"""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING

from topdress.console.app.pages.calibrate.calibration import Calibration, FrameWithAge
from topdress.console.app.pages.calibrate.guide_panel import GuideStep
from topdress.console.app.pages.calibrate.progress_rows import LineRow, ProgressRow
from topdress.console.app.widgets.action_chips import ActionChip
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen


class EffortCalibration(Calibration):
    """Guides through the reference of effort."""

    kind, name, heading = (
        "effort",
        N_("effort"),
        N_("Effort: how hard the drives of a sound machine work"),
    )

    def __init__(self, page: CalibrateScreen) -> None:
        super().__init__(page, {"cal_fit": self._fit_effort})

    def find_step(self, seen: FrameWithAge) -> int:
        # The machine works meanwhile, so there is nothing to follow step by step.
        return 0 if self.fitted is None else 1

    def list_steps(self, seen: FrameWithAge) -> tuple[GuideStep, ...]:
        return (
            GuideStep(
                _("work"),
                _(
                    "Work with a sound, warm machine for ten minutes, at several speeds and "
                    "openings. "
                    "Then Q5 fits it to this run's log."
                ),
            ),
            GuideStep(
                _("save"),
                _(
                    "E saves it as a new machine file: alarms of effort and later diagnoses "
                    "are held "
                    "against it."
                ),
            ),
        )

    def list_progress_rows(self, seen: FrameWithAge) -> tuple[ProgressRow, ...]:
        if seen.frame is None:
            return ()
        row = seen.frame.row
        return (
            LineRow(_("log"), PurePath(seen.frame.log_path).name),
            *(
                LineRow(_(word), "--" if value is None else f"{value:.3g}")
                for word, value in (
                    # The machine file declares the unit of effort: % of full duty, A or N m.
                    (N_("effort of the shaft"), row.shaft_effort),
                    (N_("effort of the gate"), row.gate_effort),
                )
            ),
        )

    def list_chips(self, seen: FrameWithAge) -> tuple[ActionChip, ...]:
        # The fit reads the log of the run, so a log must exist.
        on = seen.frame is not None and bool(seen.frame.log_path) and not self.page.busy
        return ActionChip(
            "cal_fit", "Q5", _("fit"), on, lead=on and self.fitted is None
        ), self.make_save_chip()

    def _fit_effort(self, seen: FrameWithAge) -> None:
        """Fit the effort of the drives to the log of this run, in a thread."""
        service, path = (
            self.page.required_service,
            "" if seen.frame is None else seen.frame.log_path,
        )
        if path:
            self.page.compute_in_thread(lambda: service.fit_effort(path), self.take_result)
        else:
            self.page.app.show_notice(_("nothing is recorded yet"))
