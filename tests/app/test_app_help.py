"""The help page is searched by a word."""
from __future__ import annotations

from textual.widgets import Input

from console.app.screens.help import HelpScreen
from control.orders import Do


async def test_a_word_leaves_the_lines_that_hold_it(app, source, shown):
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("f1")
        assert isinstance(app.screen, HelpScreen)
        await pilot.press("slash", *"hopper")
        text = "\n".join(shown(app))
        assert "scale trim" in text and "Machine off, from any state" not in text
        await pilot.press("enter")
        assert not isinstance(app.focused, Input)
        await pilot.press("x")
        assert [order.do for order in source.orders] == [Do.STOP], "letters are keys again"
        await pilot.press("slash", *"zzz")
        assert "no key does this on this page" in "\n".join(shown(app))
        await pilot.press("f12", "escape")
        assert source.orders[-1].do is Do.STOP and app.screen is app.page
