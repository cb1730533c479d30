"""The Job screen: a list before work, the files of the job, the N-rich strip, refills, totals,
and the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

from textual.app import ComposeResult
from textual.containers import Container, Vertical
from textual.worker import Worker, get_current_worker
from topdress.console.app.action import JOB, make_bindings
from topdress.console.app.dialogs import Choice, ChoiceDialog, Confirm
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.job.check_list import (
    CheckList,
    JobNote,
    JobNotes,
    NotesView,
    rows_of,
)
from topdress.console.app.pages.job.checklist import (
    STRIP_RUNS,
    checks,
    file_name,
    find_present_strips,
    refills,
    totals,
)
from topdress.console.app.pages.job.keys import ACTIONS
from topdress.console.app.pages.job.map_dialog import COLUMN, TAKE, UNIT, MapDialog
from topdress.console.app.pages.job.nrich import FieldRun, StripRun, read_heads
from topdress.console.app.pages.job.refill import LEAST_FILLED_KG, RefillWatch, doubt
from topdress.console.app.pages.job.service import (
    Cancelled,
    Facts,
    JobNames,
    JobService,
    MapFile,
    MapPreview,
    MapReading,
    Offer,
    Progress,
)
from topdress.console.app.pages.page import Page
from topdress.console.app.reasons import why_no_start, why_not_ready
from topdress.console.app.typed_number import in_words, inside
from topdress.console.app.view import RunView
from topdress.console.app.widgets.chips import Chip, Chips
from topdress.console.app.widgets.items import Items
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.agronomy.strips import Strips, StripValue
from topdress.control.orders import Do

# of the list before work, at most: at low and middle height ...
CHECK_ROWS = 8, 10
# ... at full height what the large keys under it, with air, and the totals leave
NEXT_ROWS = 5
# free disk space and files are looked at this often
LOOK_S = 30.0
NOTES_KEPT = 4
# no file, and no name, is called so
FOLDERS, TYPED, WRITE = "\0folders", "\0typed", "\0write"
RATE_UNITS = ("kg/ha", "lb/ac", "t/ha", "g/m2", "kg/mu", "kg N/ha", "lb N/ac", "l/ha", "gal/ac")
MAY_RESTART = (None, "off", "ready", "fault")


class JobScreen(Page):
    where: ClassVar[str] = JOB
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.strip: StripRun | None = None
        # what the heads read outside the strips of this run
        self.field = FieldRun()
        self.refill = RefillWatch()
        self.facts: Facts | None = None
        self.trouble = ""
        self.free_bytes: int | None = None
        self.said: list[str] = []  # what was done, the newest last
        self.said_of_run: list[str] = []  # and what is true only of the run that goes on
        self._run = ""  # its log
        # a file that was taken and that no worker has yet
        self.pending = ""
        self.progress = ""
        self._work: Worker[None] | None = None
        self._looked_s: float | None = None
        self._looked_at: str | None = None

    @property
    def service(self) -> JobService | None:
        return self.app.services.job

    def body(self) -> ComposeResult:
        with Vertical(id="job"):
            yield CheckList((), id="job-checks")
            yield Chips((), id="job-next", large=True)
            with Container(id="job-lower"):
                with Vertical(id="job-left"):
                    yield Items((), id="job-totals")
                yield JobNotes(NotesView((), ()), id="job-notes")

    # --- what comes in
    # ------------------------------------------------------------------------------------------

    def gather(self, frame: Frame) -> None:
        """Every frame, also while another page is shown."""
        super().gather(frame)
        # another run: nothing that was said of the one before holds of it
        if frame.log_path != self._run:
            self._run = frame.log_path
            self.refill, self.field = RefillWatch(), FieldRun()
            self.said_of_run.clear()
        before = self.refill.seen_kg
        self.refill.add(frame.row)
        if self.refill.seen_kg is not None and before is None:
            self.app.notice(
                _("the scale saw {kg} filled in: F10, F records it").format(
                    kg=self.app.units.mass.full(self.refill.seen_kg)
                )
            )
        (self.strip or self.field).add(frame.row)

    def tick(self, now_s: float) -> None:
        frame = self.app.arrival.frame
        log_path = frame.log_path if frame is not None else ""
        if self.service is not None and (
            self._looked_s is None
            or now_s - self._looked_s >= LOOK_S
            or log_path != self._looked_at
        ):
            self._looked_s, self._looked_at = now_s, log_path
            self._look(self.service, log_path)
        super().tick(now_s)

    def _look(self, service: JobService, log_path: str) -> None:
        def read() -> tuple[Facts | None, str, int | None]:
            free = service.find_free_bytes(log_path) if log_path else None
            try:
                return service.find_facts(), "", free
            except ValueError as error:
                return None, str(error), free

        def looked(found: tuple[Facts | None, str, int | None]) -> None:
            self.facts, self.trouble, self.free_bytes = found
            self.hurry()

        self.app.with_files(read, looked, group="job-look")

    def show_numbers(self, view: RunView) -> None:
        super().show_numbers(view)
        units = self.app.units
        frame, age_s = self.seen(self.app.clock())
        trouble = self.trouble or (
            "" if self.service is not None else _("files are not available here")
        )
        found = checks(frame, age_s, self.facts, trouble, self.free_bytes, units)
        listed = self.query_one("#job-checks", CheckList)
        listed.show(found)
        done = totals(frame, age_s, units, self.app.fields.of(frame))
        most, totalled = (
            CHECK_ROWS[0 if self.has_class("-low") else 1],
            self.query_one("#job-totals", Items),
        )
        if self.has_class("-tall") and self.has_class("-wide"):
            most = max(most, self.query_one("#job").size.height - NEXT_ROWS - len(done))
            totalled.styles.height = "1fr"
        else:
            # two to a row
            totalled.styles.height = (
                len(done) if self.has_class("-portrait") else -(-len(done) // 2)
            )
        listed.styles.height = min(most, rows_of(found, self.size.width))
        self.query_one("#job-next", Chips).show(self._next())
        totalled.show(done)
        self.query_one("#job-notes", JobNotes).show(
            NotesView(self._notes(frame), refills(frame, units, self.app.utc_offset_s))
        )

    def _next(self) -> tuple[Chip, ...]:
        """Where the list before work ends: make ready, then start."""
        not_ready, no_start = why_not_ready(self.app), why_no_start(self.app)
        return (
            Chip(
                "job_ready",
                "R",
                _("make ready"),
                not not_ready,
                lead=not not_ready and bool(no_start),
            ),
            Chip("job_start", "S", _("start to work"), not no_start, lead=not no_start),
        )

    def _notes(self, frame: Frame | None) -> tuple[JobNote, ...]:
        units, notes = self.app.units, []
        if self.strip is not None:
            strip = self.strip.strip
            ndvi = "--" if strip.ndvi is None else f"{strip.ndvi:.3f}"
            cv = "--" if strip.cv_percent is None else f"{strip.cv_percent:.1f}"
            notes.append(
                JobNote(
                    _(STRIP_RUNS[self.strip.which]).format(
                        way=units.distance.full(strip.length_m), ndvi=ndvi, cv=cv
                    ),
                    True,
                )
            )
        if self.refill.seen_kg is not None:
            notes.append(
                JobNote(
                    _("the scale saw {kg} filled in: F records it").format(
                        kg=units.mass.full(self.refill.seen_kg)
                    ),
                    True,
                )
            )
        if self.progress:
            notes.append(JobNote(f"{self.progress}   {_('Esc cancels')}", True))
        if self.app.joined is not None:
            known = self.app.joined.known
            notes.append(
                JobNote(
                    _("joined a machine that ran already: its files are shown")
                    if known
                    else _(
                        "joined a machine that ran already: its files cannot be read, this "
                        "console's are shown"
                    ),
                    not known,
                )
            )
        tally = frame.tally if frame is not None else None
        if tally is not None and tally.log_before:
            notes.append(JobNote(_("goes on from {log}").format(log=file_name(tally.log_before))))
        if tally is not None and tally.after_cut_kg is not None:
            scale_kg = tally.after_cut_scale_kg
            notes.append(
                JobNote(
                    _(
                        "released after the cut, and counted: about {kg} kg (by the scale {scale})"
                    ).format(
                        kg=f"{tally.after_cut_kg:.2f}",
                        scale="--" if scale_kg is None else f"{scale_kg:.2f}",
                    )
                )
            )
        if tally is not None and tally.finished:
            notes.append(
                JobNote(_("this job was ended; what you spread from now on is still added to it"))
            )
        if self.pending:
            notes.append(JobNote(_("for the next start: {name}").format(name=self.pending)))
        return (*notes, *(JobNote(text) for text in (*self.said, *self.said_of_run)[-NOTES_KEPT:]))

    def say(self, text: str) -> None:
        """A line that stays."""
        self.said[:] = [*self.said, text][-NOTES_KEPT:]
        self.hurry()

    def say_of_run(self, text: str) -> None:
        """A line that stays until another run begins."""
        self.said_of_run[:] = [*self.said_of_run, text][-NOTES_KEPT:]
        self.hurry()

    # --- actions
    # ----------------------------------------------------------------------------------------------

    def key_escape(self) -> None:
        if self._work is not None:
            self._work.cancel()
            self._work, self.progress = None, ""
            self.say(_("cancelled"))

    def ask_refill(self) -> None:
        unit, seen_kg, full_kg = self.app.units.mass, self.refill.seen_kg, self.app.hopper_kg
        frame = self.app.arrival.frame
        hopper_kg = frame.row.hopper_kg if frame is not None else None
        typed = "" if seen_kg is None else f"{seen_kg * unit.per_si:.1f}"
        text = _("Measured by the scale; Enter records it.") if seen_kg is not None else ""

        def filled(filled_kg: float) -> None:
            self.app.give(Do.REFILL, round(filled_kg, 3))
            self.app.notice(_("filled in: {mass}").format(mass=in_words(unit, filled_kg)))
            self.refill.done()

        def doubted(filled_kg: float) -> str:
            return doubt(filled_kg, self.refill, hopper_kg, full_kg, unit)

        low, high = inside(unit, LEAST_FILLED_KG, full_kg, 1)
        missing_kg = full_kg if hopper_kg is None else full_kg - hopper_kg
        # what the scale saw, else what is missing
        shown = seen_kg if seen_kg is not None else max(0.0, missing_kg)
        full = (
            ("F", _("hopper full"), round(shown * unit.per_si, 1))
            if low <= shown * unit.per_si <= high
            else None
        )
        self.app.ask(
            NumberDialog(
                _("Filled in"),
                unit.name,
                low,
                high,
                text,
                unit.to_si,
                typed=typed,
                doubt=doubted,
                full=full,
            ),
            filled,
        )

    @property
    def at_work(self) -> bool:
        """In a state in which the control worker is not started again."""
        frame = self.app.arrival.frame
        return (
            self.app.source is not None and (frame.row.state if frame else None) not in MAY_RESTART
        )

    def ask_restart(self, taken: str, left: Offer | None) -> None:
        """left: a job that has spread on the field of the next start."""
        self.pending = file_name(taken)
        self._looked_s = None
        if self.at_work:
            self.app.notice(
                _("the machine works: stop it first, then choose again to start with it")
            )
            self._drop(taken)
            return

        service = self.service

        def answer(how: str | bool | None) -> None:
            if how and service is not None:
                self.pending = ""
                self.app.restart(lambda: service.restart_worker(how == "anew"))
            else:
                self._drop(taken)

        heading = _("Change over to {name} now?").format(name=self.pending)
        if left is not None:
            self.app.push_screen(self.app.pass_question(left, heading), answer)
            return
        text = _(
            "Nothing flows until you press R and S again. Hectares and kg count from 0; "
            "strategy and nudge are "
            "the job's. Esc: nothing changes."
        )
        self.app.push_screen(Confirm(heading, text), answer)

    def _drop(self, taken: str) -> None:
        """What was taken is not started with: what runs is what is shown."""
        if self.service is not None:
            self.service.drop_choices()
        self.pending = ""
        self.say_of_run(
            _("not taken: {name}; the job goes on as it was").format(name=file_name(taken))
        )

    @property
    def field_ndvi(self) -> float | None:
        """Of the field's ground so far; before there is enough of it what the heads read now.
        None: nothing."""
        frame = self.app.arrival.frame
        now = None if frame is None else read_heads(frame.row)
        return self.field.ndvi if self.field.ndvi is not None else now

    def strips_with(self, value: StripValue | None) -> Strips:
        """The strips that will count, with the one just measured."""
        frame, facts = self.app.arrival.frame, self.facts
        now = find_present_strips(frame, facts)
        return now if value is None else now._replace(**{value.which: value.ndvi})

    def keep(self, work: Callable[[], str]) -> None:
        """A file for the next start, written by `work`; what runs now knows already."""

        def kept(path: str) -> None:
            self._looked_s = None
            self.say_of_run(
                _("counts now; for the next start: {name}").format(name=file_name(path))
            )

        self.app.with_files(work, kept, self._not_written, group="job-keep", exclusive=False)

    def _not_written(self, why: str) -> None:
        self.say(_("not written: {why}").format(why=why))

    def take(self, work: Callable[[], str]) -> None:
        """Another file for the job: written by `work`, which gives its name; then a new start
        is asked."""

        def taken() -> tuple[str, Offer | None]:
            return work(), None if self.service is None else self.service.find_offer()

        self.app.with_files(
            taken,
            lambda found: self.ask_restart(*found),
            lambda why: self.say_of_run(_("not taken: {why}").format(why=why)),
            group="job-take",
            exclusive=False,
        )

    # --- a prescription from a stick, and whose job it is
    # --------------------------------------------------------

    def look_for_maps(self, service: JobService) -> None:
        self.app.notice(_("looking for prescriptions"))
        self._bring(service.list_maps, self._list_maps)

    def _list_maps(self, found: tuple[MapFile, ...]) -> None:
        none = (
            ""
            if found
            else _("no prescription map was found: on sticks, in Downloads or in this folder")
        )
        choices = [Choice(one.path, f"{one.changed}  {one.name}  ({one.where})") for one in found]
        self.ask_path(
            _("Which prescription?"),
            choices,
            "map",
            lambda path: self._read_map(path, MapReading()),
            text=none,
        )

    def ask_path(
        self,
        title: str,
        choices: Sequence[Choice],
        kind: str,
        take: Callable[[str], None],
        now: str = "",
        text: str = "",
    ) -> None:
        """One of a list, or a file of this kind that lies elsewhere: walked to, typed or
        pasted. take: is given its path."""

        def answer(path: str) -> None:
            if path == FOLDERS:
                self._walk("", kind, take)
            elif path == TYPED:
                self.app.ask(NameDialog(title, "", _("A path, typed or pasted.")), take)
            else:
                take(path)

        more = (
            Choice(FOLDERS, _("look in folders ...")),
            Choice(TYPED, _("type or paste a path ...")),
        )
        self.app.ask(ChoiceDialog(title, [*choices, *more], now, text), answer)

    def _walk(self, folder: str, kind: str, take: Callable[[str], None]) -> None:
        """Folders up and down until a file is chosen."""
        service = self.service
        if service is not None:
            self._bring(
                lambda: service.list_map_folder(folder, kind),
                lambda found: self._list_folder(folder, found, kind, take),
            )

    def _list_folder(
        self, folder: str, found: tuple[MapFile, ...], kind: str, take: Callable[[str], None]
    ) -> None:
        def answer(path: str) -> None:
            if any(
                one.path == path and (one.name.endswith(("/", "\\")) or one.name == "..")
                for one in found
            ):
                self._walk(path, kind, take)
            else:
                take(path)

        choices = [Choice(one.path, f"{one.changed}  {one.name}".strip()) for one in found]
        nothing = (
            ""
            if any(one.changed for one in found) or not folder
            else _("nothing of the kind lies here")
        )
        self.app.ask(ChoiceDialog(folder or _("Where does it lie?"), choices, "", nothing), answer)

    def _read_map(self, path: str, reading: MapReading) -> None:
        service = self.service
        if service is not None:
            self.app.notice(_("reading the map"))
            self._bring(lambda: service.preview_map(path, reading), self._show_map)

    def _show_map(self, shown: MapPreview) -> None:
        def answer(what: str) -> None:
            if what == TAKE and self.service is not None:
                service = self.service
                self.take(lambda: service.choose_map(shown))
            elif what == COLUMN:
                self._ask_reading(
                    shown,
                    _("Which column is the rate?"),
                    [Choice(one, one) for one in shown.columns],
                    "column",
                )
            elif what == UNIT:
                self._ask_reading(
                    shown,
                    _("In which unit are the rates?"),
                    [Choice(one, one) for one in RATE_UNITS],
                    "unit",
                )

        self.app.ask(MapDialog(shown, self.app.units), answer)

    def _ask_reading(self, shown: MapPreview, title: str, choices: list[Choice], what: str) -> None:
        now = getattr(shown.reading, what)

        def answer(value: str | None) -> None:
            self._read_map(
                shown.path, shown.reading._replace(**{what: now if value is None else value})
            )

        self.app.push_screen(ChoiceDialog(title, choices, now), answer)

    def ask_who(self, service: JobService) -> None:
        """The names one after the other on one list; nothing is written before the last line is
        chosen."""
        facts = self.facts
        if facts is None:
            self.app.notice(self.trouble or _("being read"))
            return
        self._ask_name(service, facts.names)

    def _ask_name(self, service: JobService, who: JobNames) -> None:
        labels = {
            "client": _("client"),
            "farm": _("farm"),
            "field": _("field"),
            "product": _("product"),
            "operator": _("operator"),
        }
        choices = [
            Choice(name, f"{label}: {getattr(who, name) or '--'}") for name, label in labels.items()
        ]
        choices.append(Choice(WRITE, _("write the job with these names")))

        def type_name(name: str) -> None:
            self.app.push_screen(
                NameDialog(labels[name].capitalize(), getattr(who, name)), partial(named, name)
            )

        def named(name: str, text: str | None) -> None:
            if text is None:
                self._ask_name(service, who)
                return
            # a typed name is none of the library's
            file = "" if name == "product" else who.product_file
            self._ask_name(service, who._replace(**{name: text[:80]})._replace(product_file=file))

        def answer(name: str) -> None:
            if name == WRITE:
                self.take(lambda: service.save_job_names(who))
            elif name == "product" and self.facts is not None and self.facts.products:
                self._ask_product(service, who, lambda: type_name(name))
            else:
                type_name(name)

        question = ChoiceDialog(_("Whose job is it?"), choices, "")
        question.at = len(choices) - 1
        self.app.ask(question, answer)

    def _ask_product(
        self, service: JobService, who: JobNames, type_name: Callable[[], object]
    ) -> None:
        """Of the library, with its flow and its N share; or a name that is typed."""
        products = self.facts.products if self.facts is not None else ()
        choices = [
            *(Choice(one.value, one.label) for one in products),
            Choice("", _("another name: machine and crop file say the rest")),
        ]

        def answer(value: str | None) -> None:
            if value == "":
                type_name()
            else:
                label = next((one.label for one in products if one.value == value), who.product)
                self._ask_name(
                    service,
                    who if value is None else who._replace(product=label, product_file=value),
                )

        self.app.push_screen(
            ChoiceDialog(
                _("Which product? Its flow and its share of N come with it."),
                choices,
                who.product_file,
            ),
            answer,
        )

    def ask_use(self, machine: str) -> None:
        """A machine file that was just written: take it for the job? Asked over the page that
        wrote it, where Esc stays; the Job page goes on with a yes."""
        service = self.service
        if service is None:
            return

        def take() -> str:
            service.choose_file("machine", machine)
            return machine

        def use() -> None:
            self.app.turn_to(JOB)
            self.app.call_after_refresh(self.take, take)

        self.app.confirm(
            _("Use it now?"),
            _("{name} for this job: the machine goes to OFF and comes back with it.").format(
                name=file_name(machine)
            ),
            use,
        )

    def _bring(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """What is read from files, along with the screen; an error is one line that stays."""

        def failed(why: str) -> None:
            said = _("cannot be used: {why}").format(why=why)
            self.say(said)
            self.app.notice(said)

        self.app.with_files(work, then, failed, group="job-bring")

    # --- long work
    # ----------------------------------------------------------------------------------------------

    def begin(self, name: str, work: Callable[[str, Progress, Cancelled], tuple[str, ...]]) -> None:
        frame = self.app.arrival.frame
        if self._work is not None:
            self.app.notice(_("still at work: Esc cancels"))
            return
        if frame is None or not frame.log_path:
            self.app.notice(_("no log is written"))
            return
        log_path = frame.log_path

        def run() -> tuple[str, ...]:
            me = get_current_worker()

            def tell(done: int, of: int, what: str) -> None:
                if not me.is_cancelled:
                    self.progress = _("{name}: {what} ({done} of {all})").format(
                        name=name, what=_(what), done=done, all=of
                    )

            return work(log_path, tell, lambda: me.is_cancelled)

        def written(paths: tuple[str, ...]) -> None:
            self._work, self.progress = None, ""
            for path in paths:
                name = file_name(path)
                self.say(
                    _("written: {name} in {folder}").format(
                        name=name, folder=path.removesuffix(name) or "."
                    )
                )

        def failed(why: str) -> None:
            self._work, self.progress = None, ""
            self._not_written(why)

        self.progress = _("{name}: begins").format(name=name)
        self._work = self.app.with_files(run, written, failed, group="job-work")
