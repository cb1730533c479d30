"""Which channels are plotted: a list of all, Enter takes one up or drops it."""
from __future__ import annotations

from collections.abc import Callable

from textual.app import ComposeResult
from textual.widgets import Button

from console.app.channels import CHANNELS, TrendChannel
from console.app.dialogs import Choice, ChoiceDialog
from console.app.units import Units
from console.app.widgets.panel import Picked, fit
from console.locale import _

MOST = 3


class ChannelDialog(ChoiceDialog):
    """tell: called with the chosen channels' ids, in the order of choosing, after every change. A fourth one takes the
    place of the first."""

    def __init__(self, chosen: tuple[str, ...], units: Units, tell: Callable[[tuple[str, ...]], None]) -> None:
        self.chosen, self._units, self._tell = list(chosen), units, tell
        super().__init__(_("What is plotted"), self._listed(), "", _(
            "Up to three; a fourth one takes the place of the first."))

    def buttons(self) -> ComposeResult:
        yield Button(f"{_('Enter')}  {_('take or drop')}", id="yes", classes="dialog-button")
        yield Button(f"Esc  {_('close')}", id="cancel", classes="dialog-button")

    def _listed(self) -> tuple[Choice, ...]:
        return tuple(Choice(one.id, self._words(one)) for one in CHANNELS)

    def _words(self, channel: TrendChannel) -> str:
        mark = f"{self.chosen.index(channel.id) + 1}" if channel.id in self.chosen else " "
        return f"[{mark}] {fit(_(channel.label), 24)}{channel.unit(self._units).name}"

    def action_yes(self) -> None:
        if not self._wrong:
            self._turn(self.choices[self.at].value)

    def on_picked(self, event: Picked) -> None:
        """A click takes or drops: it is seen, and another one takes it back."""
        self._turn(self.choices[event.index].value)

    def _turn(self, channel: str) -> None:
        if channel in self.chosen:
            self.chosen.remove(channel)
        else:
            self.chosen = [*self.chosen, channel][-MOST:]
        self.choices = self._listed()
        self._mark()
        self._tell(tuple(self.chosen))
