"""Guides through the lag test: from the rig while the shaft may turn, or from a bench table that
was measured before.
"""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING

from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.pages.calibrate.calibration import FrameWithAge, HeldRun, make_curve
from topdress.console.app.pages.calibrate.curve_plot import CurveView
from topdress.console.app.pages.calibrate.guide_panel import GuideStep
from topdress.console.app.pages.calibrate.progress_rows import (
    BarRow,
    CellsRow,
    LineRow,
    ProgressRow,
)
from topdress.console.app.pages.calibrate.service import LagTable
from topdress.console.app.widgets.action_chips import ActionChip
from topdress.console.frame import LagTestView
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen

# Name of the rig among the machine's devices.
RIG_DEVICE = "lag_rig"
# Value of the choice that asks for a path; no path has this name.
OTHER_FILE = "other file"
# Phase of a test that the operator ended before all runs were measured.
ENDED_PHASE = "ended"
# Phases after which nothing more is measured.
FINAL_PHASES = ("done", ENDED_PHASE)
# Words for the phases of `control.calibration`.
PHASE_WORDS = {
    "settling": N_("waiting until everything stands still"),
    "arming": N_("arming the rig"),
    "running": N_("measuring"),
    "done": N_("all measured"),
    ENDED_PHASE: N_("ended"),
}


class LagCalibration(HeldRun):
    """Guides through the lag test."""

    kind, name, heading = "lag", N_("lag test"), N_("Lag test: from the command to the ground")

    def __init__(self, page: CalibrateScreen) -> None:
        super().__init__(
            page,
            {
                "cal_begin": self._toggle_lag_test,
                "cal_table": lambda _seen: self._ask_for_table(),
                "cal_fit": lambda _seen: self._fit_lag_line(),
            },
        )
        self.table: LagTable | None = None
        self.label: str | None = None
        self.test: LagTestView | None = None

    def take_frame(self, seen: FrameWithAge) -> None:
        """Process a frame. Measured runs remain, also if the test ends before all are measured."""
        # The worker sends the test in every frame while it exists.
        now = seen.frame.lag_test if seen.frame else None
        if now is not None:
            self.test = now
        elif self.is_measuring and self.test is not None:
            self.test = self.test._replace(phase=ENDED_PHASE) if self.test.runs else None

    @staticmethod
    def has_rig(seen: FrameWithAge) -> bool:
        """Return whether the machine has a lag rig."""
        return seen.frame is not None and any(
            # A rig in the cab file is a device like any other.
            device.name == RIG_DEVICE
            for device in seen.frame.devices
        )

    @property
    def is_measuring(self) -> bool:
        """Whether the test is in progress."""
        return self.test is not None and self.test.phase not in FINAL_PHASES

    @property
    def has_enough_runs(self) -> bool:
        """Whether runs at three speeds are measured, the least for a line with a measure of its
        scatter."""
        return self.test is not None and len({run[0] for run in self.test.runs}) >= 3

    def find_step(self, seen: FrameWithAge) -> int:
        if self.fitted is not None or (self.table is not None and not self.is_measuring):
            return 3
        # Before the first run the operator chooses between rig and table.
        if self.test is None:
            return 0
        # A test that ended too early must begin again.
        if self.test.phase in FINAL_PHASES:
            return 3 if self.has_enough_runs else 0
        return 1 if not seen.is_ready else 2

    def list_steps(self, seen: FrameWithAge) -> tuple[GuideStep, ...]:
        begin = (
            _("B begins the test on the rig. Or J: a bench table measured before.")
            if self.has_rig(seen)
            else _("No lag rig is in the cab file. J takes a bench table measured before.")
        )
        return (
            GuideStep(_("choose"), begin),
            GuideStep(
                _("make ready"),
                _("Rig under an outlet, tractor standing. R makes the machine ready."),
            ),
            GuideStep(
                _("measure"),
                _(
                    "Hold I: the rig starts and stops the shaft by itself. Let go at any time; it "
                    "goes on when I is held again."
                ),
            ),
            GuideStep(_("fit and save"), _("Q5 fits the line; E saves it as a new machine file.")),
            GuideStep(
                _("two rates"),
                _(
                    "Starts do not tell how the tube carries. A step from 40 to 80 r/min at the "
                    "rig, ten times, does: its table by J."
                ),
            ),
        )

    def explain_standstill(self, seen: FrameWithAge, said: str) -> str:
        # A table needs no turning shaft, so nothing is explained then.
        return super().explain_standstill(seen, said) if self.is_measuring or said else ""

    def list_progress_rows(self, seen: FrameWithAge) -> tuple[ProgressRow, ...]:
        rows: list[ProgressRow] = []
        test = self.test
        if test is not None:
            rows += [
                BarRow(_("measured"), round(test.progress, 2), f"{100 * test.progress:3.0f} %"),
                LineRow(
                    _("rig"),
                    _(PHASE_WORDS.get(test.phase, test.phase)),
                    "lead" if test.phase == "running" else "",
                ),
                LineRow(
                    _("this run"),
                    f"{test.shaft_rpm:g} r/min  #{test.replicate}   "
                    f"{_('left out: {count}').format(count=test.left_out)}",
                ),
            ]
            # The rig reports why a run was left out.
            if test.said:
                rows.append(LineRow(_("trouble"), test.said, "amber"))
            rows.append(CellsRow(("r/min", _("response s"), _("drop s"), _("lag s")), heading=True))
            rows += [
                CellsRow(
                    (f"{rpm:g}", f"{response_s:.3f}", f"{drop_s:.3f}", f"{response_s + drop_s:.3f}")
                )
                # The newest runs matter; the panel has room for six.
                for rpm, response_s, drop_s in test.runs[-6:]
            ]
        if self.table is not None:
            chosen = f"  {self.label}" if self.label else ""
            rows = [
                LineRow(_("table"), PurePath(self.table.path).name + chosen),
                LineRow(_("rows"), str(self.table.rows)),
                *rows,
            ]
        return tuple(rows) or (LineRow(_("table"), _("none chosen")),)

    def make_curve(self) -> CurveView:
        runs = self.test.runs if self.test is not None else ()
        return make_curve(
            self.fitted,
            tuple((rpm, response_s + drop_s) for rpm, response_s, drop_s in runs),
            "shaft r/min",
            "lag s",
        )

    def list_chips(self, seen: FrameWithAge) -> tuple[ActionChip, ...]:
        step, rig = self.find_step(seen), self.has_rig(seen)
        # A fit needs a table, or enough runs of a finished test.
        source = self.table is not None or (self.has_enough_runs and not self.is_measuring)
        return (
            ActionChip(
                "cal_begin",
                "B",
                _("end the test") if self.is_measuring else _("begin on the rig"),
                rig,
                lead=step == 0 and rig,
            ),
            ActionChip(
                "cal_table",
                "J",
                _("bench table"),
                not seen.is_calibrating,
                lead=step == 0 and not rig,
            ),
            ActionChip(
                "cal_ready", "R", _("make ready"), not seen.is_ready and rig, lead=step == 1
            ),
            ActionChip(
                "cal_run",
                "I",
                _("run while held"),
                self.is_measuring and seen.is_ready,
                lead=step == 2,
                held=True,
            ),
            ActionChip(
                "cal_fit",
                "Q5",
                _("fit"),
                source and not self.page.busy,
                lead=step == 3 and source and self.fitted is None,
            ),
            self.make_save_chip(),
        )

    def _toggle_lag_test(self, seen: FrameWithAge) -> None:
        """Begin the lag test on the rig, or end the test in progress."""
        # The key is visible without a rig, so its notice explains what is missing.
        if not self.has_rig(seen):
            self.page.app.show_notice(_("no lag rig is in the cab file"))
            return
        # One key begins and ends, like a stop watch.
        begin = not self.is_measuring
        self.page.app.run_worker(
            self.page.app.ask_source(lambda source: source.send_lag_test_order(begin)),
            group="orders",
            exit_on_error=False,
        )
        if begin:
            # A test on the rig replaces a table that was chosen before.
            self.table, self.label = None, None
            self.forget_result()

    def _ask_for_table(self) -> None:
        """Ask for a bench table; the list is read in a thread."""
        service = self.page.required_service
        self.page.compute_in_thread(lambda: tuple(service.lag_tables()), self._show_tables)

    def _show_tables(self, tables: tuple[LagTable, ...]) -> None:
        """Ask which of the tables to use, or for a path where none was found."""
        choices = [
            Choice(table.path, f"{PurePath(table.path).name}  ({table.rows})") for table in tables
        ]
        # A table may lie on a memory stick.
        choices.append(Choice(OTHER_FILE, _("another file: type its path")))

        def open_chosen(path: str) -> None:
            if path == OTHER_FILE:
                self.page.ask_question(NameDialog(_("Bench table (CSV)"), ""), self._open_table)
            else:
                self._adopt_table(next(table for table in tables if table.path == path))

        if tables:
            self.page.ask_question(ChoiceDialog(_("Which bench table?"), choices, ""), open_chosen)
        else:
            open_chosen(OTHER_FILE)

    def _open_table(self, path: str) -> None:
        """Read a table from a path, in a thread."""
        service = self.page.required_service
        self.page.compute_in_thread(lambda: service.open_lag_table(path), self._adopt_table)

    def _adopt_table(self, table: LagTable) -> None:
        """Adopt a table, and ask for its rows if it has several labels."""
        self.table, self.label = table, None
        self.forget_result()
        # A table with labels contains several tests, which must not be mixed in one fit.
        if table.labels:
            self.page.ask_question(
                ChoiceDialog(
                    _("Which rows?"), [Choice(label, label) for label in table.labels], ""
                ),
                self._adopt_label,
            )
        else:
            self._fit_lag_line()

    def _adopt_label(self, label: str) -> None:
        """Adopt the rows of a label and fit the line."""
        self.label = label
        self._fit_lag_line()

    def _fit_lag_line(self) -> None:
        """Fit the lag line to the chosen table, else to the runs of the rig."""
        service, table, label = self.page.required_service, self.table, self.label
        path = (
            table.path
            if table is not None
            else self.test.table_path
            if self.has_enough_runs and self.test
            else ""
        )
        if not path:
            self.page.app.show_notice(_("nothing is measured yet: B on the rig, or J for a table"))
        else:
            self.page.compute_in_thread(lambda: service.fit_lag(path, label), self.take_result)
