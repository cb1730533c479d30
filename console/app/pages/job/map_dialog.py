"""A prescription before it is taken: what it looks like, how its numbers are read, what of it will not be applied."""
from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.widgets import Button, Static

from console.app.dialogs import Dialog
from console.app.pages.job.day import file_name
from console.app.pages.job.map_words import map_words
from console.app.pages.job.service import MapPreview
from console.app.small_map import SHADES, preview
from console.app.units import Units
from console.locale import _

COLUMNS, ROWS = 44, 9
TAKE, COLUMN, UNIT = "take", "column", "unit"


class MapDialog(Dialog[str | None]):
    """Dismissed with what to do next: TAKE, COLUMN or UNIT; None: nothing."""

    AUTO_FOCUS = "#map-scroll"
    BINDINGS: ClassVar = [Binding("1", "choose('column')", show=False), Binding("2", "choose('unit')", show=False)]

    def __init__(self, shown: MapPreview, units: Units) -> None:
        super().__init__(file_name(shown.path))
        self.shown, self.units = shown, units

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="map-scroll", classes="dialog wide"):
            yield Static(self.heading, classes="dialog-title", markup=False)
            yield Static("\n".join(self.lines()), classes="dialog-text", id="map-said", markup=False)
            with Horizontal(classes="dialog-buttons"):
                if not self.shown.question:
                    yield Button(f"{_('Enter')}  {_('take it')}", id="yes", classes="dialog-button")
                yield Button(f"1  {_('column')}", id=COLUMN, classes="dialog-button")
                yield Button(f"2  {_('unit')}", id=UNIT, classes="dialog-button")
                yield Button(f"Esc  {_('cancel')}", id="cancel", classes="dialog-button")

    def lines(self) -> tuple[str, ...]:
        shown, units = self.shown, self.units
        if shown.question:
            return (_("Before it can be used, one thing has to be said: 1 column, 2 unit."), shown.question)
        low, high = shown.rates_kg_ha
        drawn = preview(shown.picture, COLUMNS, ROWS)
        legend = f"{SHADES[0]} {units.rate.full(low)}   {SHADES[-1]} {units.rate.full(high)}"
        said = map_words(shown.check, units) if shown.check is not None else ()
        return (*drawn, legend, _("{area}, {mass} in all").format(area=units.area.full(shown.area_ha),
                                                                mass=units.mass.full(shown.mass_kg)),
                _("column {column}, read as {unit}").format(column=shown.reading.column or "--", unit=shown.unit),
                *(f"! {one}" for one in said))

    def action_choose(self, what: str) -> None:
        if what != COLUMN or self.shown.columns:
            self.dismiss(what)

    def action_yes(self) -> None:
        if not self.shown.question:
            self.dismiss(TAKE)

    def on_button_pressed(self, event: Button.Pressed) -> None:
        if event.button.id in (COLUMN, UNIT):
            event.stop()
            self.action_choose(event.button.id)
