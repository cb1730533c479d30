"""What shaft and gate are to do in a calibrating run. Pure; the run itself and its hold-to-run are in `ordered`."""
from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from control.orders import Answer, Do, Order, State
from control.safety.words import refusal

SETTINGS = (Do.CALIBRATE_SHAFT, Do.CALIBRATE_OPENING)


class BenchSetting(NamedTuple):
    """Wanted set-points, before the drives' limits. A run begins with a standing shaft and the gate where it is."""

    shaft_rpm: float = 0.0
    opening_mm: float | None = None     # None: stays


class BenchRun(NamedTuple):
    """A calibrating run as the console shows it."""

    shaft_rpm: float                    # set-points as sent
    opening_mm: float
    elapsed_s: float
    left_s: float


def after_setting(setting: BenchSetting, order: Order, state: State) -> tuple[BenchSetting, Answer]:
    """The set-points after one of `SETTINGS`; refused unless calibrating, and for what is no number of at least 0.

    A number above the drives' limits is taken and cut by the last gate (`limited`): the frame tells what was sent.
    """
    if state is not State.CALIBRATING:
        return setting, Answer(False, refusal("not_from_state", state=state.value))
    value = order.value
    if isinstance(value, bool | str) or value is None or not (isfinite(value) and value >= 0.0):
        return setting, Answer(False, refusal("calibrate_setting"))
    if order.do is Do.CALIBRATE_SHAFT:
        return setting._replace(shaft_rpm=float(value)), Answer(True)
    return setting._replace(opening_mm=float(value)), Answer(True)
