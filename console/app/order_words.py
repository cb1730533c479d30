"""Words an order, either as given or as offered. Pure."""

from __future__ import annotations

from topdress.console.app import frame_words
from topdress.console.app.typed_number import format_with_unit
from topdress.console.app.units import Unit, Units
from topdress.console.locale import N_, _
from topdress.control.agronomy.reference_strips import parse_strip
from topdress.control.orders import Do

# Orders are keyed by their names on the wire, which a frame of another version may extend.
ORDER_NAMES: dict[str, str] = {
    Do.READY: N_("READY"),
    Do.START: N_("START"),
    Do.HOLD: N_("HOLD"),
    Do.STOP: N_("STOP"),
    Do.CALIBRATE: N_("calibrating"),
    Do.RELEASE: N_("end of calibrating"),
    Do.STRATEGY: N_("strategy"),
    Do.SOURCE: N_("target"),
    Do.NUDGE: N_("nudge"),
    Do.MANUAL_RATE: N_("manual rate"),
    Do.MARK: N_("mark"),
    Do.REFILL: N_("refill"),
    Do.REFILL_BACK: N_("refill taken back"),
    Do.ALLOW_REVERSE: N_("flow in reverse"),
    Do.ALLOW_OUTSIDE: N_("flow outside the field"),
    Do.ALLOW_MAP_ELSEWHERE: N_("a map that lies elsewhere"),
    Do.GO_ON_UNLOGGED: N_("work without a log"),
    Do.ALLOW_NO_WHEEL: N_("work without the wheel"),
    Do.FLOW_TRIM: N_("scale trim"),
    Do.LOOK_AHEAD: N_("look-ahead"),
    Do.NO_DOUBLE: N_("nothing twice"),
    Do.SECTION: N_("section"),
    Do.STRIP: N_("strip"),
    Do.DOSE_ERROR: N_("dose error"),
    Do.CALIBRATE_SHAFT: N_("calibrating, shaft"),
    Do.CALIBRATE_OPENING: N_("calibrating, opening"),
}
STRIP_NAMES = {"nrich": N_("N-rich strip"), "check": N_("farmer check")}


def format_order(do: str, value: str | float | bool | None, units: Units) -> str:
    """Return an order in words.

    Parameters
    ----------
    do
        Name of the order; an unknown name of another version is returned unchanged.
    value
        Value as in the order, or as text in a frame.
    units
        Units of the numbers in the text.
    """
    word = _(ORDER_NAMES[do]) if do in ORDER_NAMES else do
    strip = parse_strip(value) if do == Do.STRIP else None
    if strip is not None:
        named = _(STRIP_NAMES[strip.which])
        return (
            _("no {strip}").format(strip=named)
            if strip.ndvi is None
            else f"{named} NDVI {strip.ndvi:.3f}"
        )
    return f"{word} {_format_order_value(do, '' if value is None else str(value), units)}".rstrip()


def _format_order_value(do: str, value: str, units: Units) -> str:
    """Return the value in words. START and CALIBRATE return "", because their value is the button's
    id."""
    if do in (Do.START, Do.CALIBRATE, Do.MARK, Do.STRIP):
        return ""
    # A frame transports booleans as text.
    if value in ("True", "False"):
        return _("on") if value == "True" else _("off")
    if do == Do.STRATEGY:
        return frame_words.name_strategy(value)
    if do == Do.SOURCE:
        return frame_words.name_source(value)
    try:
        number = float(value)
    except ValueError:
        return value
    shown = {Do.MANUAL_RATE: units.rate, Do.REFILL: units.mass, Do.REFILL_BACK: units.mass}
    plain = {
        Do.NUDGE: "%",
        Do.DOSE_ERROR: "m",
        Do.CALIBRATE_SHAFT: "r/min",
        Do.CALIBRATE_OPENING: "mm",
    }
    # An order of another version has an unknown unit, so the bare number is shown.
    unit = (
        shown.get(Do(do), Unit(plain.get(Do(do), ""), 1.0, 1))
        if do in ORDER_NAMES
        else Unit("", 1.0, 1)
    )
    return (
        f"{'+' if do == Do.NUDGE and number >= 0.0 else ''}{format_with_unit(unit, number)}"
    ).rstrip()
