"""Which channels are plotted: a list of all, Enter takes one up or drops it."""
from __future__ import annotations

from collections.abc import Callable

from textual.app import ComposeResult
from textual.widgets import Button, OptionList
from textual.widgets.option_list import Option

from console.app.channels import CHANNELS, Channel
from console.app.dialogs import Dialog
from console.app.units import Units
from console.app.widgets.panel import fit
from console.locale import _

MOST = 3


class ChannelDialog(Dialog[None]):
    """tell: called with the chosen channels' ids, in the order of choosing, after every change. A fourth one takes the
    place of the first."""

    AUTO_FOCUS = "#channel-list"
    VERTICAL_BREAKPOINTS = [(0, "-low"), (30, "-tall")]

    def __init__(self, chosen: tuple[str, ...], units: Units, tell: Callable[[tuple[str, ...]], None]) -> None:
        super().__init__(_("What is plotted"), _("Up to three; a fourth one takes the place of the first."))
        self.chosen, self._units, self._tell = list(chosen), units, tell
        self.add_class("channels")

    def body(self) -> ComposeResult:
        yield OptionList(*(Option(self._words(channel), id=channel.id) for channel in CHANNELS), id="channel-list",
                         markup=False)

    def buttons(self) -> ComposeResult:
        yield Button(f"{_('Enter')}  {_('take or drop')}", id="yes", classes="dialog-button")
        yield Button(f"Esc  {_('close')}", id="cancel", classes="dialog-button")

    def _words(self, channel: Channel) -> str:
        mark = f"{self.chosen.index(channel.id) + 1}" if channel.id in self.chosen else " "
        return f"[{mark}] {fit(_(channel.label), 24)}{channel.unit(self._units).name}"

    def action_yes(self) -> None:
        options = self.query_one("#channel-list", OptionList)
        if options.highlighted is not None:
            self._turn(CHANNELS[options.highlighted].id)

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        event.stop()
        if event.option_id is not None:
            self._turn(event.option_id)

    def _turn(self, channel: str) -> None:
        if channel in self.chosen:
            self.chosen.remove(channel)
        else:
            self.chosen = [*self.chosen, channel][-MOST:]
        options = self.query_one("#channel-list", OptionList)
        for one in CHANNELS:
            options.replace_option_prompt(one.id, self._words(one))
        self._tell(tuple(self.chosen))
