"""Shows a prescription map before the job uses it: its picture, the meaning of its numbers, and the
parts that will not be applied.
"""

from __future__ import annotations

from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.widgets import Static
from topdress.console.app.dialogs import Choice, ChoiceDialog, Dialog
from topdress.console.app.map_ink import PLAN_LEVEL_SIGNS, draw_small_map, find_planned_scale
from topdress.console.app.pages.job.checklist import find_file_name
from topdress.console.app.pages.job.map_words import describe_map_check
from topdress.console.app.pages.job.service import MapPreview
from topdress.console.app.units import Units
from topdress.console.app.widgets.choice_list import ChoiceList
from topdress.console.app.widgets.map_legend import draw_colour_ramp
from topdress.console.locale import _

# Size of the picture and of the colour ramp, in cells.
PICTURE_COLUMNS, MAX_PICTURE_ROWS, MIN_PICTURE_ROWS, RAMP_CELLS = 44, 9, 3, 16
# Rows of the screen that the text below the picture needs first.
ROWS_BELOW_PICTURE = 20
# Answers of the dialog.
TAKE_CHOICE, COLUMN_CHOICE, UNIT_CHOICE = "take", "column", "unit"


class MapDialog(ChoiceDialog):
    """Shows a map before the job uses it. The answer is the next step: take, column or unit. The
    text above the choices scrolls."""

    BINDINGS: ClassVar = [
        Binding("pageup", "scroll_text(-5)", show=False),
        Binding("pagedown", "scroll_text(5)", show=False),
    ]

    def __init__(self, shown: MapPreview, units: Units) -> None:
        # While the meaning of the rates is unknown, the map cannot be taken.
        asked = bool(shown.question)
        wanted = (
            *(() if asked else (Choice(TAKE_CHOICE, _("take it")),)),
            *(
                (Choice(COLUMN_CHOICE, _("the column that is the rate ...")),)
                if shown.columns
                else ()
            ),
            Choice(UNIT_CHOICE, _("the unit of the rates ...")),
        )
        super().__init__(find_file_name(shown.path), wanted, "")
        self.shown, self.units = shown, units

    def compose(self) -> ComposeResult:
        """Yield picture, text and choices."""
        with Vertical(classes="dialog wide"):
            yield Static(self.heading, classes="dialog-title", markup=False)
            with VerticalScroll(classes="dialog-body", can_focus=False):
                yield Static(
                    Content("\n").join(self.draw_rows()),
                    classes="dialog-text",
                    id="map-said",
                    markup=False,
                )
            yield ChoiceList(self._make_view(), id="choices")
            with Horizontal(classes="dialog-buttons"):
                yield from self.compose_buttons()

    def on_resize(self, event: events.Resize) -> None:
        """Draw the picture for the new size."""
        Dialog.on_resize(self, event)
        self.query_one("#map-said", Static).update(Content("\n").join(self.draw_rows()))

    def action_scroll_text(self, lines: int) -> None:
        """Scroll the text."""
        self.query_one(".dialog-body").scroll_relative(y=lines, animate=False)

    def draw_rows(self) -> tuple[Content, ...]:
        """Return picture and text as rows."""
        shown, units = self.shown, self.units
        if shown.question:
            return Content(_("Before this map can be used, say what its rates are.")), Content(
                shown.question
            )
        rows = max(
            MIN_PICTURE_ROWS, min(MAX_PICTURE_ROWS, self.app.size.height - ROWS_BELOW_PICTURE)
        )
        drawn = [
            Content.assemble(*row)
            for row in draw_small_map(self, shown.picture, PICTURE_COLUMNS, rows)
        ]
        scale = find_planned_scale(shown.picture, units)
        ramp = (
            (text, str(style))
            for text, style in draw_colour_ramp(self, scale, RAMP_CELLS, PLAN_LEVEL_SIGNS)
        )
        said = describe_map_check(shown.check, units) if shown.check is not None else ()
        return (
            *drawn,
            Content.assemble(
                f"{scale.format_value(scale.low)} ",
                *ramp,
                f" {scale.format_value(scale.high)} {scale.unit}",
            ),
            *map(
                Content,
                (
                    _("{area}, {mass} in all").format(
                        area=units.area.format_with_name(shown.area_ha),
                        mass=units.mass.format_with_name(shown.mass_kg),
                    ),
                    _("column {column}, read as {unit}").format(
                        column=shown.reading.column or "--", unit=shown.unit
                    ),
                    *(f"! {one}" for one in said),
                ),
            ),
        )
