"""Shows the Job screen: checks before work, the job's files, N-rich strip, refills, totals, end of
the job.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

from textual.app import ComposeResult
from textual.containers import Container, Vertical
from textual.worker import Worker, get_current_worker
from topdress.console.app.action import JOB, make_bindings
from topdress.console.app.dialogs import Choice, ChoiceDialog, Confirm
from topdress.console.app.impossible_reasons import explain_no_start, explain_not_ready
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.job.checklist import (
    STRIP_RUNS,
    JobCheck,
    find_file_name,
    find_strips_in_force,
    list_checks,
    list_refills,
    make_total_items,
)
from topdress.console.app.pages.job.checklist_panel import (
    CheckList,
    JobNote,
    JobNotes,
    NotesView,
    count_check_rows,
)
from topdress.console.app.pages.job.keys import ACTIONS
from topdress.console.app.pages.job.map_dialog import (
    COLUMN_CHOICE,
    TAKE_CHOICE,
    UNIT_CHOICE,
    MapDialog,
)
from topdress.console.app.pages.job.refill import MIN_REFILL_KG, RefillWatch, explain_refill_doubt
from topdress.console.app.pages.job.service import (
    IsCancelled,
    JobFacts,
    JobNames,
    JobOffer,
    JobService,
    MapFile,
    MapPreview,
    MapReading,
    Progress,
)
from topdress.console.app.pages.job.strip_measurement import FieldMean, StripRun, find_heads_index
from topdress.console.app.panel_views import RunView
from topdress.console.app.typed_number import format_with_unit, round_inwards
from topdress.console.app.widgets.action_chips import ActionChip, Chips
from topdress.console.app.widgets.labelled_values import Items
from topdress.console.frame import Frame
from topdress.console.locale import _
from topdress.control.agronomy.reference_strips import ReferenceStrips, StripMean
from topdress.control.orders import Do

# Rows of the checks at low and at middle height.
MAX_CHECK_ROWS = 8, 10
# At full height the checks leave this many rows to the large keys with their margin, and the rows
# of the totals.
KEY_AREA_ROWS = 5
# Period at which free space and the job's files are read again, s.
FILE_CHECK_PERIOD_S = 30.0
# Notes on the screen; older notes are dropped.
MAX_NOTES = 4
# Values of choices that are no file and no name: the NUL character cannot occur in either.
BROWSE_CHOICE, TYPE_PATH_CHOICE, WRITE_CHOICE = "\0folders", "\0typed", "\0write"
# Units that a prescription map may have.
RATE_UNITS = ("kg/ha", "lb/ac", "t/ha", "g/m2", "kg/mu", "kg N/ha", "lb N/ac", "l/ha", "gal/ac")
# States in which a restart of the worker interrupts no work.
RESTART_STATES = (None, "off", "ready", "fault")


class JobScreen(Page):
    """Shows checks, files, strip, refills and totals."""

    where: ClassVar[str] = JOB
    BINDINGS: ClassVar = make_bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.strip: StripRun | None = None
        # Mean NDVI outside the strips of this run.
        self.field = FieldMean()
        self.refill = RefillWatch()
        self.facts: JobFacts | None = None
        self.trouble = ""
        self.free_bytes: int | None = None
        # Notes about finished actions, newest last.
        self.said: list[str] = []
        # Notes that are valid for the present run only.
        self.run_notes: list[str] = []
        # Log of the present run.
        self._run_log_path = ""
        # File that was chosen but is not used by any worker yet.
        self.pending = ""
        self.progress = ""
        self._work: Worker[None] | None = None
        self._checked_s: float | None = None
        self._checked_log_path: str | None = None

    @property
    def service(self) -> JobService | None:
        """Service of the page, or None."""
        return self.app.services.job

    def compose_body(self) -> ComposeResult:
        with Vertical(id="job"):
            yield CheckList((), id="job-checks")
            yield Chips((), id="job-next", large=True)
            with Container(id="job-lower"):
                with Vertical(id="job-left"):
                    yield Items((), id="job-totals")
                yield JobNotes(NotesView((), ()), id="job-notes")

    # The following methods take frames and the contents of files.

    def gather_frame(self, frame: Frame) -> None:
        """Process every frame, also while another page is open."""
        super().gather_frame(frame)
        # Notes about the former run are not valid for a new run.
        if frame.log_path != self._run_log_path:
            self._run_log_path = frame.log_path
            # Both measure within one run.
            self.refill, self.field = RefillWatch(), FieldMean()
            self.run_notes.clear()
        before = self.refill.seen_kg
        self.refill.add_row(frame.row)
        if self.refill.seen_kg is not None and before is None:
            self.app.show_notice(
                _("the scale saw {kg} filled in: F10, F records it").format(
                    kg=self.app.units.mass.format_with_name(self.refill.seen_kg)
                )
            )
        # A strip must not contribute to the field's mean, which it is compared with.
        (self.strip or self.field).add_row(frame.row)

    def show_due(self, now_s: float) -> None:
        frame = self.app.arrival.frame
        log_path = frame.log_path if frame is not None else ""
        if self.service is not None and (
            self._checked_s is None
            or now_s - self._checked_s >= FILE_CHECK_PERIOD_S
            # Another log means that the worker uses other files.
            or log_path != self._checked_log_path
        ):
            self._checked_s, self._checked_log_path = now_s, log_path
            self._read_facts(self.service, log_path)
        super().show_due(now_s)

    def _read_facts(self, service: JobService, log_path: str) -> None:
        """Read the job's files and the free space, in a thread."""

        def read_from_files() -> tuple[JobFacts | None, str, int | None]:
            # Free space is read first, so that unreadable job files do not hide it.
            free = service.find_free_bytes(log_path) if log_path else None
            try:
                return service.find_facts(), "", free
            except ValueError as error:
                return None, str(error), free

        def take_facts(found: tuple[JobFacts | None, str, int | None]) -> None:
            self.facts, self.trouble, self.free_bytes = found
            self.refresh_all_next_tick()

        self.app.run_with_files(read_from_files, take_facts, group="job-look")

    def show_numbers(self, view: RunView) -> None:
        """Show checks, totals and notes."""
        super().show_numbers(view)
        units = self.app.units
        frame, age_s = self.find_frame(self.app.clock())
        found = self.list_checks()
        listed = self.query_one("#job-checks", CheckList)
        listed.show_view(found)
        # The totals are counted before the layout, which depends on their number.
        done = make_total_items(frame, age_s, units, self.app.fields.find_picture(frame))
        most, totalled = (
            MAX_CHECK_ROWS[0 if self.has_class("-low") else 1],
            self.query_one("#job-totals", Items),
        )
        if self.has_class("-tall") and self.has_class("-wide"):
            most = max(most, self.query_one("#job").size.height - KEY_AREA_ROWS - len(done))
            totalled.styles.height = "1fr"
        else:
            # Two totals share a row.
            totalled.styles.height = (
                len(done) if self.has_class("-portrait") else -(-len(done) // 2)
            )
        listed.styles.height = min(most, count_check_rows(found, self.size.width))
        self.query_one("#job-next", Chips).show_view(self._list_next_chips())
        totalled.show_view(done)
        self.query_one("#job-notes", JobNotes).show_view(
            NotesView(self._list_notes(frame), list_refills(frame, units, self.app.utc_offset_s))
        )

    def list_checks(self) -> tuple[JobCheck, ...]:
        """Return the checks before work."""
        frame, age_s = self.find_frame(self.app.clock())
        return list_checks(
            frame,
            age_s,
            self.facts,
            self.trouble,
            self.free_bytes,
            self.app.units,
            is_elsewhere=self.service is None,
        )

    def _list_next_chips(self) -> tuple[ActionChip, ...]:
        """Return the keys at the end of the checks: make ready, then start."""
        not_ready, no_start = explain_not_ready(self.app), explain_no_start(self.app)
        return (
            ActionChip(
                "job_ready",
                "R",
                _("make ready"),
                not not_ready,
                lead=not not_ready and bool(no_start),
            ),
            ActionChip("job_start", "S", _("start to work"), not no_start, lead=not no_start),
        )

    def _list_notes(self, frame: Frame | None) -> tuple[JobNote, ...]:
        """Return the notes: strip in progress, refill, work in progress, joined machine, power cut,
        files for the next start."""
        units, notes = self.app.units, []
        if self.strip is not None:
            strip = self.strip.strip
            ndvi = "--" if strip.ndvi is None else f"{strip.ndvi:.3f}"
            cv = "--" if strip.cv_percent is None else f"{strip.cv_percent:.1f}"
            notes.append(
                JobNote(
                    _(STRIP_RUNS[self.strip.which]).format(
                        way=units.distance.format_with_name(strip.length_m), ndvi=ndvi, cv=cv
                    ),
                    True,
                )
            )
        if self.refill.seen_kg is not None:
            notes.append(
                JobNote(
                    _("the scale saw {kg} filled in: F records it").format(
                        kg=units.mass.format_with_name(self.refill.seen_kg)
                    ),
                    True,
                )
            )
        if self.progress:
            # Work in progress is loud, so that it stays visible.
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
            notes.append(
                JobNote(_("goes on from {log}").format(log=find_file_name(tally.log_before)))
            )
        # Material that flowed while nobody controlled the machine was estimated after the cut.
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
        return (*notes, *(JobNote(text) for text in (*self.said, *self.run_notes)[-MAX_NOTES:]))

    def add_note(self, text: str) -> None:
        """Add a note that stays."""
        self.said[:] = [*self.said, text][-MAX_NOTES:]
        self.refresh_all_next_tick()

    def add_run_note(self, text: str) -> None:
        """Add a note that stays until another run begins."""
        self.run_notes[:] = [*self.run_notes, text][-MAX_NOTES:]
        self.refresh_all_next_tick()

    # The following methods perform the actions of the page.

    def key_escape(self) -> None:
        """Cancel the work in progress."""
        if self._work is not None:
            self._work.cancel()
            self._work, self.progress = None, ""
            self.add_note(_("cancelled"))

    def ask_refill(self) -> None:
        """Ask for the mass that was filled in, then record it."""
        unit, seen_kg, full_kg = self.app.units.mass, self.refill.seen_kg, self.app.hopper_kg
        frame = self.app.arrival.frame
        hopper_kg = frame.row.hopper_kg if frame is not None else None
        # The scale's mass is proposed and can be confirmed by Enter.
        typed = "" if seen_kg is None else f"{seen_kg * unit.per_si:.1f}"
        text = _("Measured by the scale; Enter records it.") if seen_kg is not None else ""

        def give_refill(filled_kg: float) -> None:
            self.app.give_order(Do.REFILL, round(filled_kg, 3))
            self.app.show_notice(
                _("filled in: {mass}").format(mass=format_with_unit(unit, filled_kg))
            )
            self.refill.end_refill()

        def explain_doubt(filled_kg: float) -> str:
            return explain_refill_doubt(filled_kg, self.refill, hopper_kg, full_kg, unit)

        low, high = round_inwards(unit, MIN_REFILL_KG, full_kg, 1)
        missing_kg = full_kg if hopper_kg is None else full_kg - hopper_kg
        # The key "hopper full" enters the mass that the scale saw, else the missing mass.
        shown = seen_kg if seen_kg is not None else max(0.0, missing_kg)
        full = (
            ("F", _("hopper full"), round(shown * unit.per_si, 1))
            if low <= shown * unit.per_si <= high
            else None
        )
        self.app.ask_question(
            NumberDialog(
                _("Filled in"),
                unit.name,
                low,
                high,
                text,
                unit.convert_to_si,
                typed=typed,
                doubt=explain_doubt,
                full=full,
            ),
            give_refill,
        )

    @property
    def is_at_work(self) -> bool:
        """Whether the machine's state forbids a restart of the control worker."""
        frame = self.app.arrival.frame
        return (
            self.app.source is not None
            and (frame.row.state if frame else None) not in RESTART_STATES
        )

    def ask_restart(self, taken: str, left: JobOffer | None) -> None:
        """Ask for a restart with the chosen files.

        Parameters
        ----------
        taken
            Path of the chosen file.
        left
            Interrupted job that has spread on the field of the next start.
        """
        self.pending = find_file_name(taken)
        # The files are read again soon, because they have changed.
        self._checked_s = None
        if self.is_at_work:
            self.app.show_notice(
                _("the machine works: stop it first, then choose again to start with it")
            )
            self._drop_choice(taken)
            return

        service = self.service

        def take_answer(how: str | bool | None) -> None:
            if how and service is not None:
                self.pending = ""
                self.app.restart_source(lambda: service.restart_worker(how == "anew"))
            else:
                self._drop_choice(taken)

        heading = _("Change over to {name} now?").format(name=self.pending)
        # An interrupted job on the field needs a decision before the restart.
        if left is not None:
            self.app.push_screen(self.app.make_pass_question(left, heading), take_answer)
            return
        text = _(
            "Nothing flows until you press R and S again. Hectares and kg count from 0; "
            "strategy and nudge are "
            "the job's. Esc: nothing changes."
        )
        self.app.push_screen(Confirm(heading, text), take_answer)

    def _drop_choice(self, taken: str) -> None:
        """Drop the choice; the running files stay in use."""
        if self.service is not None:
            self.service.drop_choices()
        self.pending = ""
        self.add_run_note(
            _("not taken: {name}; the job goes on as it was").format(name=find_file_name(taken))
        )

    @property
    def field_ndvi(self) -> float | None:
        """Mean NDVI of the field outside strips; before there are enough readings, the present
        NDVI. None means unknown."""
        frame = self.app.arrival.frame
        now = None if frame is None else find_heads_index(frame.row)
        return self.field.ndvi if self.field.ndvi is not None else now

    def replace_strip(self, value: StripMean | None) -> ReferenceStrips:
        """Return the strips in force after the strip that was just measured."""
        frame, facts = self.app.arrival.frame, self.facts
        now = find_strips_in_force(frame, facts)
        return now if value is None else now._replace(**{value.which: value.ndvi})

    def save_for_next_start(self, work: Callable[[], str]) -> None:
        """Write a file for the next start; the running worker already knows its content by an
        order."""

        def note_saved(path: str) -> None:
            self._checked_s = None
            self.add_run_note(
                _("counts now; for the next start: {name}").format(name=find_file_name(path))
            )

        self.app.run_with_files(
            work, note_saved, self._note_not_written, group="job-keep", exclusive=False
        )

    def _note_not_written(self, why: str) -> None:
        """Report that a file was not written."""
        self.add_note(_("not written: {why}").format(why=why))

    def choose_written_file(self, work: Callable[[], str]) -> None:
        """Write another file for the job by `work`, which returns its name; then ask for a
        restart."""

        def write_and_find_offer() -> tuple[str, JobOffer | None]:
            return work(), None if self.service is None else self.service.find_offer()

        self.app.run_with_files(
            write_and_find_offer,
            lambda found: self.ask_restart(*found),
            lambda why: self.add_run_note(_("not taken: {why}").format(why=why)),
            group="job-take",
            exclusive=False,
        )

    # The following methods take a prescription map and the names of the job.

    def look_for_maps(self, service: JobService) -> None:
        """List the maps on memory sticks and in folders, and ask for one of them."""
        self.app.show_notice(_("looking for prescriptions"))
        self._read_files(service.list_maps, self._show_maps)

    def _show_maps(self, found: tuple[MapFile, ...]) -> None:
        """Ask for one of the maps, or for a path."""
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
        """Ask for an entry of a list, or for a file of this kind elsewhere: browsed, typed or
        pasted.

        Parameters
        ----------
        title
            Heading of the dialog.
        choices
            Files of the list.
        kind
            Kind of file for the browser: map, job, crop or machine.
        take
            Receives the path.
        now
            Path of the file in use.
        text
            Text above the list.
        """

        def take_choice(path: str) -> None:
            if path == BROWSE_CHOICE:
                self._browse_folder("", kind, take)
            elif path == TYPE_PATH_CHOICE:
                self.app.ask_question(NameDialog(title, "", _("A path, typed or pasted.")), take)
            else:
                take(path)

        more = (
            Choice(BROWSE_CHOICE, _("look in folders ...")),
            Choice(TYPE_PATH_CHOICE, _("type or paste a path ...")),
        )
        self.app.ask_question(ChoiceDialog(title, [*choices, *more], now, text), take_choice)

    def _browse_folder(self, folder: str, kind: str, take: Callable[[str], None]) -> None:
        """Browse folders until a file is chosen."""
        service = self.service
        if service is not None:
            self._read_files(
                lambda: service.list_map_folder(folder, kind),
                lambda found: self._show_folder(folder, found, kind, take),
            )

    def _show_folder(
        self, folder: str, found: tuple[MapFile, ...], kind: str, take: Callable[[str], None]
    ) -> None:
        """Show the contents of a folder; a folder opens, a file is taken."""

        def take_choice(path: str) -> None:
            if any(
                # A folder's name ends in a slash or backslash, and ".." leads upwards.
                one.path == path and (one.name.endswith(("/", "\\")) or one.name == "..")
                for one in found
            ):
                self._browse_folder(path, kind, take)
            else:
                take(path)

        choices = [Choice(one.path, f"{one.changed}  {one.name}".strip()) for one in found]
        nothing = (
            ""
            if any(one.changed for one in found) or not folder
            else _("nothing of the kind lies here")
        )
        self.app.ask_question(
            ChoiceDialog(folder or _("Where does it lie?"), choices, "", nothing), take_choice
        )

    def _read_map(self, path: str, reading: MapReading) -> None:
        """Read a map in a thread, and show it."""
        service = self.service
        if service is not None:
            self.app.show_notice(_("reading the map"))
            self._read_files(lambda: service.preview_map(path, reading), self._show_map)

    def _show_map(self, shown: MapPreview) -> None:
        """Show a map, and process the operator's next step."""

        def take_choice(what: str) -> None:
            if what == TAKE_CHOICE and self.service is not None:
                service = self.service
                self.choose_written_file(lambda: service.choose_map(shown))
            elif what == COLUMN_CHOICE:
                self._ask_how_to_read_map(
                    shown,
                    _("Which column is the rate?"),
                    [Choice(one, one) for one in shown.columns],
                    "column",
                )
            elif what == UNIT_CHOICE:
                self._ask_how_to_read_map(
                    shown,
                    _("In which unit are the rates?"),
                    [Choice(one, one) for one in RATE_UNITS],
                    "unit",
                )

        self.app.ask_question(MapDialog(shown, self.app.units), take_choice)

    def _ask_how_to_read_map(
        self, shown: MapPreview, title: str, choices: list[Choice], what: str
    ) -> None:
        """Ask for the column or unit of the rates, and read the map again."""
        now = getattr(shown.reading, what)

        def take_choice(value: str | None) -> None:
            self._read_map(
                shown.path, shown.reading._replace(**{what: now if value is None else value})
            )

        self.app.push_screen(ChoiceDialog(title, choices, now), take_choice)

    def ask_names(self, service: JobService) -> None:
        """Ask for the job's names on one list; nothing is written before the last entry is
        chosen."""
        facts = self.facts
        if facts is None:
            self.app.show_notice(self.trouble or _("being read"))
            return
        self._ask_for_name(service, facts.names)

    def _ask_for_name(self, service: JobService, who: JobNames) -> None:
        """Show the list of names, and ask for the chosen name."""
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
        choices.append(Choice(WRITE_CHOICE, _("write the job with these names")))

        def ask_text(name: str) -> None:
            self.app.push_screen(
                NameDialog(labels[name].capitalize(), getattr(who, name)), partial(take_name, name)
            )

        def take_name(name: str, text: str | None) -> None:
            if text is None:
                self._ask_for_name(service, who)
                return
            # A typed name belongs to no product file of the library.
            file = "" if name == "product" else who.product_file
            # Other programs truncate longer names.
            self._ask_for_name(
                service, who._replace(**{name: text[:80]})._replace(product_file=file)
            )

        def take_choice(name: str) -> None:
            if name == WRITE_CHOICE:
                self.choose_written_file(lambda: service.save_job_names(who))
            elif name == "product" and self.facts is not None and self.facts.products:
                self._ask_product(service, who, lambda: ask_text(name))
            else:
                ask_text(name)

        question = ChoiceDialog(_("Whose job is it?"), choices, "")
        # The last entry writes the job, so that an Enter accepts the names as they are.
        question.at = len(choices) - 1
        self.app.ask_question(question, take_choice)

    def _ask_product(
        self, service: JobService, who: JobNames, type_name: Callable[[], object]
    ) -> None:
        """Ask for a product of the library, which brings its flow and N share, or for a typed
        name."""
        products = self.facts.products if self.facts is not None else ()
        choices = [
            *(Choice(one.value, one.label) for one in products),
            Choice("", _("another name: machine and crop file say the rest")),
        ]

        def take_choice(value: str | None) -> None:
            if value == "":
                type_name()
            else:
                label = next((one.label for one in products if one.value == value), who.product)
                self._ask_for_name(
                    service,
                    who if value is None else who._replace(product=label, product_file=value),
                )

        self.app.push_screen(
            ChoiceDialog(
                _("Which product? Its flow and its share of N come with it."),
                choices,
                who.product_file,
            ),
            take_choice,
        )

    def ask_to_use_machine(self, machine: str) -> None:
        """Ask whether the job uses a machine file that was just written. The question covers the
        page that wrote the file; a yes opens the Job page."""
        service = self.service
        if service is None:
            return

        def choose_in_service() -> str:
            service.choose_file("machine", machine)
            return machine

        def use_on_job_page() -> None:
            self.app.turn_to_page(JOB)
            self.app.call_after_refresh(self.choose_written_file, choose_in_service)

        self.app.ask_yes_no(
            _("Use it now?"),
            _("{name} for this job: the machine goes to OFF and comes back with it.").format(
                name=find_file_name(machine)
            ),
            use_on_job_page,
        )

    def _read_files(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Read files in a thread; an error becomes a note that stays."""

        def note_failure(why: str) -> None:
            said = _("cannot be used: {why}").format(why=why)
            self.add_note(said)
            self.app.show_notice(said)

        self.app.run_with_files(work, then, note_failure, group="job-bring")

    # The following methods run exports and reports in a thread.

    def begin_work(
        self, name: str, work: Callable[[str, Progress, IsCancelled], tuple[str, ...]]
    ) -> None:
        """Begin an export or report in a thread.

        Parameters
        ----------
        name
            Name of the work for the notes.
        work
            Receives the log's path, a progress function and a cancellation check; returns the
            written paths.
        """
        frame = self.app.arrival.frame
        if self._work is not None:
            self.app.show_notice(_("still at work: Esc cancels"))
            return
        if frame is None or not frame.log_path:
            self.app.show_notice(_("no log is written"))
            return
        log_path = frame.log_path

        def run_in_thread() -> tuple[str, ...]:
            me = get_current_worker()

            def note_progress(done: int, of: int, what: str) -> None:
                # Progress of cancelled work would replace that of newer work.
                if not me.is_cancelled:
                    self.progress = _("{name}: {what} ({done} of {all})").format(
                        name=name, what=_(what), done=done, all=of
                    )

            return work(log_path, note_progress, lambda: me.is_cancelled)

        def note_written(paths: tuple[str, ...]) -> None:
            self._work, self.progress = None, ""
            for path in paths:
                name = find_file_name(path)
                self.add_note(
                    _("written: {name} in {folder}").format(
                        name=name, folder=path.removesuffix(name) or "."
                    )
                )

        def note_failure(why: str) -> None:
            self._work, self.progress = None, ""
            self._note_not_written(why)

        self.progress = _("{name}: begins").format(name=name)
        self._work = self.app.run_with_files(
            run_in_thread, note_written, note_failure, group="job-work"
        )
