"""What the terminal at hand can show."""
from __future__ import annotations

from textual.app import App


def few_colours(app: App[object]) -> bool:
    """Whether colours cannot carry a scale: NO_COLOR, or a terminal of 16 colours or none."""
    return app.no_color or (not app.is_headless and app.console.color_system in (None, "standard", "windows"))
