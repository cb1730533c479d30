"""Explains in one line why an action is impossible now; "" where it is possible. The newest frame
decides here, and safety decides finally.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from topdress.console.app.frame_words import name_state
from topdress.console.locale import _
from topdress.control.orders import Severity, State
from topdress.control.safety import STATE_REASONS

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp


def explain_no_machine(app: TopdressApp) -> str:
    """Return why nothing can be ordered without a machine. The key of STOP opens the connection
    dialog meanwhile."""
    return (
        _("no connection to the machine: {key} connects").format(key=app.find_shown_key("stop"))
        if app.is_disconnected
        else ""
    )


def explain_no_undo(app: TopdressApp) -> str:
    """Return why nothing can be undone."""
    newest = app.undo.newest
    if newest is None:
        return _("nothing was changed that could be taken back")
    # A change without orders, such as a setting, needs no machine.
    return explain_no_machine(app) if newest.orders else ""


def explain_no_acknowledge(app: TopdressApp) -> str:
    """Return why nothing can be acknowledged."""
    frame = app.arrival.frame
    owed = frame is not None and any(
        one.severity is Severity.RED and not one.acknowledged for one in frame.alarms
    )
    return "" if owed else _("no alarm waits for it")


def explain_no_tour(app: TopdressApp) -> str:
    """Return why no step of the tour can be skipped."""
    return _("no tour is shown") if app.tour is None else ""


def explain_no_start(app: TopdressApp) -> str:
    """Return why the machine cannot be started."""
    return _explain_wrong_state(app, (State.READY, State.HELD), State.WORKING)


def explain_not_ready(app: TopdressApp) -> str:
    """Return why the machine cannot be made ready."""
    return _explain_wrong_state(app, (State.OFF, State.HELD, State.FAULT), State.READY)


def _explain_wrong_state(app: TopdressApp, from_: tuple[State, ...], already: State) -> str:
    """Return why an order is impossible in the present state, with the key that leads on."""
    if app.source is None:
        return _("no machine is connected")
    frame = app.arrival.frame
    # Without a fresh frame the worker must decide.
    if frame is None or app.gone or frame.row.state in from_:
        return ""
    # A worker that only records has no drives to start.
    if frame.why_state == "record_only":
        return _(STATE_REASONS[frame.why_state])
    now = name_state(frame.row.state)
    if frame.row.state == already:
        return _("the machine is {state} already").format(state=now)
    first = find_first_key(app, already, frame.row.state)
    if first:
        return _("the machine is {state}: press {key} first").format(state=now, key=first)
    return _("the machine is {state}; this begins from {states}").format(
        state=now, states=", ".join(name_state(one.value) for one in from_)
    )


def find_first_key(app: TopdressApp, wanted: State, state: str | None) -> str:
    """Return the displayed key that leads from a state towards the wanted state; "" without such a
    key."""
    # From WORKING the machine must be held before it becomes ready.
    if wanted is State.READY:
        return app.find_shown_key("hold") if state == State.WORKING else ""
    return app.find_shown_key("ready") if state in (State.OFF, State.FAULT, State.HELD) else ""
