"""The lag test on the screen: from the rig while the shaft may turn, or from a bench table that
was measured before."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING

from topdress.console.app.dialogs import Choice, ChoiceDialog
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.pages.calibrate.calibration import FrameSeen, HeldRun, make_curve
from topdress.console.app.pages.calibrate.curve import CurveView
from topdress.console.app.pages.calibrate.guide import GuideStep
from topdress.console.app.pages.calibrate.progress_rows import Bar, Cells, Line, Row
from topdress.console.app.pages.calibrate.service import LagTable
from topdress.console.app.widgets.chips import Chip
from topdress.console.frame import LagTestView
from topdress.console.locale import N_, _

if TYPE_CHECKING:
    from topdress.console.app.pages.calibrate.page import CalibrateScreen

RIG = "lag_rig"
OTHER = "other file"
ENDED = "ended"  # by hand, before all was measured
OVER = ("done", ENDED)
PHASES = {
    "settling": N_("waiting until everything stands still"),
    "arming": N_("arming the rig"),
    "running": N_("measuring"),
    "done": N_("all measured"),
    ENDED: N_("ended"),
}


class LagCalibration(HeldRun):
    kind, name, heading = "lag", N_("lag test"), N_("Lag test: from the command to the ground")

    def __init__(self, page: CalibrateScreen) -> None:
        super().__init__(
            page,
            {
                "cal_begin": self._begin,
                "cal_table": lambda _seen: self._ask_table(),
                "cal_fit": lambda _seen: self._fit(),
            },
        )
        self.table: LagTable | None = None
        self.label: str | None = None
        self.test: LagTestView | None = None

    def see(self, seen: FrameSeen) -> None:
        """What was measured stays, also when the test is ended before all is measured."""
        now = seen.frame.lag_test if seen.frame else None
        if now is not None:
            self.test = now
        elif self.measuring and self.test is not None:
            self.test = self.test._replace(phase=ENDED) if self.test.runs else None

    @staticmethod
    def has_rig(seen: FrameSeen) -> bool:
        return seen.frame is not None and any(device.name == RIG for device in seen.frame.devices)

    @property
    def measuring(self) -> bool:
        return self.test is not None and self.test.phase not in OVER

    @property
    def measured(self) -> bool:
        return self.test is not None and len({run[0] for run in self.test.runs}) >= 3

    def step(self, seen: FrameSeen) -> int:
        if self.fitted is not None or (self.table is not None and not self.measuring):
            return 3
        if self.test is None:
            return 0
        if self.test.phase in OVER:
            return 3 if self.measured else 0
        return 1 if not seen.ready else 2

    def steps(self, seen: FrameSeen) -> tuple[GuideStep, ...]:
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

    def trouble(self, seen: FrameSeen, said: str) -> str:
        return super().trouble(seen, said) if self.measuring or said else ""

    def sheet(self, seen: FrameSeen) -> tuple[Row, ...]:
        rows: list[Row] = []
        test = self.test
        if test is not None:
            rows += [
                Bar(_("measured"), round(test.progress, 2), f"{100 * test.progress:3.0f} %"),
                Line(
                    _("rig"),
                    _(PHASES.get(test.phase, test.phase)),
                    "lead" if test.phase == "running" else "",
                ),
                Line(
                    _("this run"),
                    f"{test.shaft_rpm:g} r/min  #{test.replicate}   "
                    f"{_('left out: {count}').format(count=test.left_out)}",
                ),
            ]
            if test.said:
                rows.append(Line(_("trouble"), test.said, "amber"))
            rows.append(Cells(("r/min", _("response s"), _("drop s"), _("lag s")), heading=True))
            rows += [
                Cells(
                    (f"{rpm:g}", f"{response_s:.3f}", f"{drop_s:.3f}", f"{response_s + drop_s:.3f}")
                )
                for rpm, response_s, drop_s in test.runs[-6:]
            ]
        if self.table is not None:
            chosen = f"  {self.label}" if self.label else ""
            rows = [
                Line(_("table"), PurePath(self.table.path).name + chosen),
                Line(_("rows"), str(self.table.rows)),
                *rows,
            ]
        return tuple(rows) or (Line(_("table"), _("none chosen")),)

    def curve(self) -> CurveView:
        runs = self.test.runs if self.test is not None else ()
        return make_curve(
            self.fitted,
            tuple((rpm, response_s + drop_s) for rpm, response_s, drop_s in runs),
            "shaft r/min",
            "lag s",
        )

    def chips(self, seen: FrameSeen) -> tuple[Chip, ...]:
        step, rig = self.step(seen), self.has_rig(seen)
        source = self.table is not None or (self.measured and not self.measuring)
        return (
            Chip(
                "cal_begin",
                "B",
                _("end the test") if self.measuring else _("begin on the rig"),
                rig,
                lead=step == 0 and rig,
            ),
            Chip(
                "cal_table", "J", _("bench table"), not seen.calibrating, lead=step == 0 and not rig
            ),
            Chip("cal_ready", "R", _("make ready"), not seen.ready and rig, lead=step == 1),
            Chip(
                "cal_run",
                "I",
                _("run while held"),
                self.measuring and seen.ready,
                lead=step == 2,
                held=True,
            ),
            Chip(
                "cal_fit",
                "Q5",
                _("fit"),
                source and not self.page.busy,
                lead=step == 3 and source and self.fitted is None,
            ),
            self.save_chip(),
        )

    def _begin(self, seen: FrameSeen) -> None:
        if not self.has_rig(seen):
            self.page.app.notice(_("no lag rig is in the cab file"))
            return
        begin = not self.measuring
        self.page.app.run_worker(
            self.page.app.asked(lambda source: source.send_lag_test_order(begin)),
            group="orders",
            exit_on_error=False,
        )
        if begin:
            self.table, self.label = None, None
            self.forget()

    def _ask_table(self) -> None:
        service = self.page.served
        self.page.compute(lambda: tuple(service.lag_tables()), self._offer)

    def _offer(self, tables: tuple[LagTable, ...]) -> None:
        choices = [
            Choice(table.path, f"{PurePath(table.path).name}  ({table.rows})") for table in tables
        ]
        choices.append(Choice(OTHER, _("another file: type its path")))

        def chosen(path: str) -> None:
            if path == OTHER:
                self.page.ask(NameDialog(_("Bench table (CSV)"), ""), self._open)
            else:
                self._take_table(next(table for table in tables if table.path == path))

        if tables:
            self.page.ask(ChoiceDialog(_("Which bench table?"), choices, ""), chosen)
        else:
            chosen(OTHER)

    def _open(self, path: str) -> None:
        service = self.page.served
        self.page.compute(lambda: service.open_lag_table(path), self._take_table)

    def _take_table(self, table: LagTable) -> None:
        self.table, self.label = table, None
        self.forget()
        if table.labels:
            self.page.ask(
                ChoiceDialog(
                    _("Which rows?"), [Choice(label, label) for label in table.labels], ""
                ),
                self._label,
            )
        else:
            self._fit()

    def _label(self, label: str) -> None:
        self.label = label
        self._fit()

    def _fit(self) -> None:
        service, table, label = self.page.served, self.table, self.label
        path = (
            table.path
            if table is not None
            else self.test.table_path
            if self.measured and self.test
            else ""
        )
        if not path:
            self.page.app.notice(_("nothing is measured yet: B on the rig, or J for a table"))
        else:
            self.page.compute(lambda: service.fit_lag(path, label), self.take)
