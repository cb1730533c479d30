"""Small bars in the text: an interval about its value, and shares of one."""
from __future__ import annotations

WIDTH, HEIGHT = 220.0, 22.0
MARGIN = 8.0


def interval_bar(value: float, low: float, high: float, said: str) -> str:
    """A line from low to high with its value, and where zero is. `said`: the same in words, already escaped."""
    least, most = min(0.0, low, value), max(0.0, high, value)
    wide = (most - least) or 1.0

    def at(x: float) -> float:
        return MARGIN + (x - least) / wide * (WIDTH - 2.0 * MARGIN)
    middle = HEIGHT / 2.0
    return (f'<svg class="bar" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}" height="{HEIGHT:g}" role="img" '
            f'aria-label="{said}"><line class="base" x1="{at(least):.1f}" x2="{at(most):.1f}" y1="{middle:g}" '
            f'y2="{middle:g}"/><line class="zero" x1="{at(0.0):.1f}" x2="{at(0.0):.1f}" y1="2" y2="{HEIGHT - 2.0:g}"/>'
            f'<line class="interval" x1="{at(low):.1f}" x2="{at(high):.1f}" y1="{middle:g}" y2="{middle:g}"/>'
            f'<circle class="value" cx="{at(value):.1f}" cy="{middle:g}" r="5"/></svg>')


def share_bar(share: float, said: str, leading: bool) -> str:
    """A bar filled to a share between 0 and 1."""
    full = WIDTH - 2.0 * MARGIN
    filled = full * min(1.0, max(0.0, share))
    return (f'<svg class="bar" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}" height="{HEIGHT:g}" role="img" '
            f'aria-label="{said}"><rect class="trough" x="{MARGIN:g}" y="5" width="{full:g}" height="12" rx="2"/>'
            f'<rect class="{"share" if leading else "other"}" x="{MARGIN:g}" y="5" width="{filled:.1f}" height="12" '
            f'rx="2"/></svg>')
