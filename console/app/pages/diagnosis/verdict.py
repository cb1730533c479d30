"""Shows the verdict in a word and a sentence with the next step, and that of the separating run."""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from textual.content import Content
from topdress.console.app.widgets.base_panel import Panel, choose_longest_fit, make_line, wrap_text

_VERDICT_STYLES = {
    "none": "bold reverse",
    "named": "bold $on-alarm-amber on $alarm-amber",
    "ambiguous": "bold $on-alarm-amber on $alarm-amber",
    "unexplained": "bold $on-alarm-red on $alarm-red",
    "not_judged": "bold $on-alarm-red on $alarm-red",
}


class VerdictTexts(NamedTuple):
    """Holds a verdict in words. `verdict` is its id; `lead` names the data where two verdicts are
    shown."""

    verdict: str
    symbol: str
    word: str
    # Facts about the data; the last are dropped first where room is scarce.
    about: tuple[str, ...]
    sentence: str
    todo: str
    lead: str = ""


class VerdictPanel(Panel[tuple[VerdictTexts, ...]]):
    """Shows word and data, sentence and next step. Two verdicts are stacked, with fewer rows
    each."""

    def draw_rows(self, view: tuple[VerdictTexts, ...], width: int, height: int) -> list[Content]:
        rows: list[Content] = []
        for index, said in enumerate(view):
            room = (height - len(rows)) // (len(view) - index)
            rows += self._draw_verdict(said, width, room)
        return rows

    @staticmethod
    def _draw_verdict(said: VerdictTexts, width: int, room: int) -> list[Content]:
        """Return the rows of one verdict; the sentence has priority over the next step."""
        lead = f"{said.lead}: " if said.lead else ""
        left = cell_len(f" {said.symbol} {said.word}   {lead}")
        about = choose_longest_fit(
            ("   ".join(said.about[:kept]) for kept in range(len(said.about), -1, -1)), width - left
        )
        head = make_line(
            (f" {said.symbol} {said.word} ", _VERDICT_STYLES[said.verdict]),
            (f"  {lead}", "bold"),
            (about, "$muted"),
        )
        todo = [
            make_line((f" > {row}" if not k else f"   {row}", "bold $primary"))
            for k, row in enumerate(wrap_text(said.todo, width - 4))
        ]
        sentence = [make_line((f" {row}", "bold")) for row in wrap_text(said.sentence, width - 2)]
        spare = room - 1 - len(sentence)
        return [head, *sentence[: max(1, room - 1)], *todo[: max(0, spare)]]
