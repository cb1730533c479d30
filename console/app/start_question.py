"""START where the numbers of the machine are not in sight: asked, on every page but Run."""
from __future__ import annotations

from typing import TYPE_CHECKING

from console.app.dialogs import Confirm
from console.locale import _
from control.orders import Do

if TYPE_CHECKING:
    from console.app.app import TopdressApp


def start_from_any_page(app: TopdressApp) -> None:
    """Where the numbers of the machine are not in sight, START is asked."""
    def answer(yes: bool | None) -> None:
        if yes:
            app.give(Do.START)

    app.push_screen(Confirm(_("Start to work?"), _("The machine begins to spread as soon as it moves.")), answer)
