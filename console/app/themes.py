"""Defines the themes day, night and high contrast, with colours for target, applied, alarms and
states besides Textual's own names.

Alarms are orange (severity red) and blue (severity amber), the pair that colour-blind people
distinguish. STOP is red, work is green, a selection is yellow: none resembles an alarm. All pairs
also differ in 16 colours, which a test checks.
"""

from __future__ import annotations

from textual.theme import Theme


def _make_own_theme(
    name: str,
    *,
    dark: bool,
    background: str,
    surface: str,
    panel: str,
    foreground: str,
    primary: str,
    stale: str,
    muted: str,
    target: str,
    red: tuple[str, str],
    amber: tuple[str, str],
    states: dict[str, tuple[str, str]],
    bar: tuple[str, str],
    key: str,
    stop: tuple[str, str],
    select: tuple[str, str],
) -> Theme:
    """Return a Textual theme with the variables that the style sheets use. Pairs are (background,
    text)."""
    # Variables of the style sheets that Textual's themes do not have.
    variables = {
        "stale": stale,
        "muted": muted,
        "target": target,
        "applied": foreground,
        "alarm-red": red[0],
        "on-alarm-red": red[1],
        "alarm-amber": amber[0],
        "on-alarm-amber": amber[1],
        "keybar": bar[0],
        "on-keybar": bar[1],
        "keybar-key": key,
        "track": panel,
        "stop": stop[0],
        "on-stop": stop[1],
        "select": select[0],
        "on-select": select[1],
        "block-cursor-foreground": select[1],
        "block-cursor-background": select[0],
        "input-cursor-text-style": "none",
    }
    # Each state has a pair of colours for its word in the status line.
    for state, (back, fore) in states.items():
        variables |= {f"state-{state}": back, f"on-state-{state}": fore}
    return Theme(
        name=name,
        dark=dark,
        background=background,
        surface=surface,
        panel=panel,
        foreground=foreground,
        primary=primary,
        secondary=target,
        accent=primary,
        warning=amber[0],
        error=red[0],
        success=target,
        # Textual brightens nested containers by default, which would change the tested contrasts.
        boost=surface,
        # Transparent text would lose contrast in sunlight.
        text_alpha=1.0,
        variables=variables,
    )


# White and black are readable in sunlight.
DAY_THEME = _make_own_theme(
    "day",
    dark=False,
    background="#ffffff",
    surface="#f1f3f4",
    panel="#d5dade",
    foreground="#000000",
    primary="#00518f",
    stale="#62686e",
    muted="#4a5056",
    target="#02608a",
    red=("#ff8a00", "#000000"),
    amber=("#0053b8", "#ffffff"),
    states={
        "off": ("#d5dade", "#000000"),
        "ready": ("#ffffff", "#00518f"),
        "working": ("#3fbf6f", "#000000"),
        "held": ("#000000", "#ffffff"),
        "calibrating": ("#5b3a8e", "#ffffff"),
        "fault": ("#ff8a00", "#000000"),
    },
    bar=("#e3e7ea", "#000000"),
    key="#00518f",
    stop=("#b80024", "#ffffff"),
    select=("#ffe27a", "#000000"),
)

# Muted colours preserve the operator's night vision.
NIGHT_THEME = _make_own_theme(
    "night",
    dark=True,
    background="#0b0d0f",
    surface="#13171a",
    panel="#2a3136",
    foreground="#c3c7c4",
    primary="#6fa8cf",
    stale="#777e84",
    muted="#99a0a3",
    target="#4aa3c8",
    red=("#d9780f", "#000000"),
    amber=("#215bb0", "#f0f4f8"),
    states={
        "off": ("#2a3136", "#c3c7c4"),
        "ready": ("#0b0d0f", "#6fa8cf"),
        "working": ("#2fa565", "#000000"),
        "held": ("#c3c7c4", "#0b0d0f"),
        "calibrating": ("#7a5ab0", "#ffffff"),
        "fault": ("#d9780f", "#000000"),
    },
    bar=("#1a1f23", "#c3c7c4"),
    key="#8fc4e8",
    stop=("#a8102c", "#ffffff"),
    select=("#c9b25a", "#000000"),
)

# Pure colours suit displays of low contrast and operators with impaired sight.
CONTRAST_THEME = _make_own_theme(
    "contrast",
    dark=True,
    background="#000000",
    surface="#000000",
    panel="#555555",
    foreground="#ffffff",
    primary="#ffff00",
    stale="#808080",
    muted="#d0d0d0",
    target="#55aaff",
    red=("#ff9a00", "#000000"),
    amber=("#2a55ff", "#ffffff"),
    states={
        "off": ("#555555", "#ffffff"),
        "ready": ("#000000", "#ffff00"),
        "working": ("#00e676", "#000000"),
        "held": ("#ffffff", "#000000"),
        "calibrating": ("#ff55ff", "#000000"),
        "fault": ("#ff9a00", "#000000"),
    },
    bar=("#000000", "#ffffff"),
    key="#ffff00",
    stop=("#d00020", "#ffffff"),
    select=("#ffff00", "#000000"),
)

# The order is that of the key that switches themes.
THEMES = (DAY_THEME, NIGHT_THEME, CONTRAST_THEME)
THEME_NAMES = tuple(theme.name for theme in THEMES)


def find_next_theme(name: str) -> str:
    """Return the name of the next theme; all themes share one key."""
    return (
        THEME_NAMES[(THEME_NAMES.index(name) + 1) % len(THEME_NAMES)]
        if name in THEME_NAMES
        else THEME_NAMES[0]
    )
