"""What does each of the operator's orders to the loop change, and why is it refused? Orders to
safety are passed on.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from math import inf, isfinite
from typing import Any

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.reference_strips import StripMean, parse_strip
from topdress.control.field.job import Job
from topdress.control.loop.tick_state import OperatorChoices
from topdress.control.metering.flow_trim import FlowTrim
from topdress.control.metering.pair_planner import PairPlanner
from topdress.control.orders import MAP_SOURCES, Answer, Do, Order, State, Strategy, TargetSource
from topdress.control.safety import BenchSetting, Safety, apply_bench_order, make_refusal
from topdress.control.targets.plant_doser import OTHER_PLANT_DISTANCE_M, PlantDoser

# `3 off`, `3 auto` and `all auto` are the words of the order; ASCII excludes other digits.
_SECTION_PATTERN = re.compile(r"(?P<number>\d{1,2}) (?P<to>off|auto)|all auto", re.ASCII)
# A larger correction is a wrong set rate and not a nudge, %.
MAX_NUDGE_PERCENT = 30.0
# Resolution of a recorded refill, kg.
REFILL_STEP_KG = 0.1
ACCEPTED = Answer(True)


class LoopOrderHandler:
    """Holds the operator's choices. `started`: called after safety has accepted START;
    `why_no_start`: returns the reason why START is refused, or ""."""

    def __init__(
        self,
        job: Job,
        crop: Crop,
        safety: Safety,
        setting: PairPlanner,
        *,
        flow_trim: FlowTrim,
        points: PlantDoser | None,
        has_map: bool,
        started: Callable[[], None],
        strip_measured: Callable[[StripMean], None],
        sections: int = 0,
        hopper_kg: float = inf,
        why_no_start: Callable[[], str] = str,
        record_only: bool = False,
    ) -> None:
        """Creates the object with the job's choices. hopper_kg: capacity of the hopper, which
        limits a refill."""
        self._record_only = record_only
        self.choices = OperatorChoices(
            TargetSource(job.target.source),
            job.target.manual_rate_kg_ha,
            job.look_ahead,
            job.flow_trim,
            job.no_double,
        )
        # The bench begins with no set-point, so a bench run never repeats an old one.
        self.bench = BenchSetting()
        self.refilled = False
        self._crop, self._job = crop, job
        self._safety = safety
        self._setting = setting
        self._flow_trim = flow_trim
        self._points = points
        self._started = started
        self._why_no_start = why_no_start
        self._strip_measured = strip_measured
        self._sections = sections
        self._hopper_kg = hopper_kg
        # A source appears only if the job has what it needs.
        placed = (
            *((source, has_map) for source in MAP_SOURCES),
            (TargetSource.POINT, points is not None),
            (TargetSource.EXTERNAL, job.target.source is TargetSource.EXTERNAL),
        )
        self.sources = (
            TargetSource.CANOPY,
            TargetSource.MANUAL,
            TargetSource.FALLBACK,
            *(source for source, there in placed if there),
        )

    def handle_order(self, order: Order, now_s: float) -> tuple[Answer, str]:
        """Executes or refuses an order; returns the answer and the row's event, "" for none."""
        before = self._safety.state
        # A held button sends its order again and again; only the first is an event.
        # Repeated orders mean that the button is held down.
        held_down = (order.do is Do.CALIBRATE and before is State.CALIBRATING) or (
            order.do is Do.START and before is State.WORKING and self._safety.start_is_held(now_s)
        )
        answer = (
            self._handle_safety_order(order, now_s, held_down)
            if order.do not in _HANDLERS
            else _HANDLERS[order.do](self, order, now_s)
        )
        if not answer.accepted or held_down or order.do is Do.ACKNOWLEDGE:
            return answer, ""
        return (
            answer,
            order.do.value
            if order.value is None
            # A semicolon separates events in the log.
            else f"{order.do.value} {order.value}".replace(";", ","),
        )

    def _handle_strategy(self, order: Order, now_s: float) -> Answer:
        if order.value not in list(Strategy):
            return Answer(False, "unknown_strategy")
        self._setting.switch_strategy(Strategy(str(order.value)), now_s)
        return ACCEPTED

    def _handle_source(self, order: Order, now_s: float) -> Answer:
        """Changes the source; map and point require a job with them."""
        if order.value not in self.sources:
            return Answer(False, "source_not_ready")
        self.choices = self.choices._replace(source=TargetSource(str(order.value)))
        return ACCEPTED

    def _handle_nudge(self, order: Order, now_s: float) -> Answer:
        percent = _read_number(order)
        # "not <=" also refuses a value that is not a number.
        if percent is None or not abs(percent) <= MAX_NUDGE_PERCENT:
            return Answer(False, "nudge_out_of_range")
        self.choices = self.choices._replace(nudge_percent=percent)
        return ACCEPTED

    def _handle_manual_rate(self, order: Order, now_s: float) -> Answer:
        rate = _read_number(order)
        if rate is None or not 0.0 <= rate <= self._crop.max_rate_kg_ha:
            return Answer(False, "rate_out_of_range")
        self.choices = self.choices._replace(manual_rate_kg_ha=rate)
        return ACCEPTED

    def _handle_switch(self, order: Order, now_s: float) -> Answer:
        if not isinstance(order.value, bool):
            return Answer(False, "yes_or_no")
        if (
            order.do is Do.NO_DOUBLE
            and not order.value
            and self._job.nitrogen.year_max_kg_ha is not None
        ):
            # A job with a yearly ceiling must not spread twice on any ground.
            return Answer(False, "year_ceiling")
        if order.do is Do.FLOW_TRIM:
            # The trim starts anew at each switch.
            self._flow_trim.reset_calibration()
        chosen: dict[str, Any] = {_SWITCH_FIELDS[order.do]: order.value}
        self.choices = self.choices._replace(**chosen)
        return ACCEPTED

    def _handle_section(self, order: Order, now_s: float) -> Answer:
        """Closes a section by hand, or returns the section to automatic control."""
        found = _SECTION_PATTERN.fullmatch(order.value) if isinstance(order.value, str) else None
        if found is None:
            return Answer(False, "section_off_or_auto")
        if found["number"] is None:
            # The order opens all sections again, also if none was closed by hand.
            self.choices = self.choices._replace(sections_off=())
            return ACCEPTED if self._sections else Answer(False, "no_such_section")
        number = int(found["number"])
        if not 1 <= number <= self._sections:
            return Answer(False, "no_such_section")
        others = {other for other in self.choices.sections_off if other != number}
        off = others | {number} if found["to"] == "off" else others
        self.choices = self.choices._replace(sections_off=tuple(sorted(off)))
        return ACCEPTED

    def _handle_strip(self, order: Order, now_s: float) -> Answer:
        """Stores a measured strip, which applies from the next decision on; earlier decisions
        stay."""
        strip = parse_strip(order.value)
        if strip is None:
            return Answer(False, "strip_out_of_range")
        self._strip_measured(strip)
        return ACCEPTED

    def _handle_dose_error(self, order: Order, now_s: float) -> Answer:
        error_m = _read_number(order)
        if error_m is None or abs(error_m) > OTHER_PLANT_DISTANCE_M:
            return Answer(False, "dose_error_out_of_range")
        # A measured error can be assigned only to a dose that has landed.
        if self._points is None or not self._points.learn_dose_error(error_m, now_s):
            return Answer(False, "no_dose_landed")
        return ACCEPTED

    def _handle_bench_setting(self, order: Order, now_s: float) -> Answer:
        self.bench, answer = apply_bench_order(self.bench, order, self._safety.state)
        return answer

    def _handle_mark(self, order: Order, now_s: float) -> Answer:
        return ACCEPTED

    def _handle_refill_back(self, order: Order, now_s: float) -> Answer:
        """Cancels the last refill in the log by an event; its effect on safety stays."""
        kg = _read_number(order)
        return ACCEPTED if kg is not None and kg > 0.0 else Answer(False, "refill_kg")

    def _handle_safety_order(self, order: Order, now_s: float, held_down: bool) -> Answer:
        """Passes an order to safety, and executes the effect of an accepted order here."""
        before = self._safety.state
        # A recorder never commands the drives.
        if self._record_only and order.do in (Do.READY, Do.START, Do.CALIBRATE):
            return Answer(False, "record_only")
        # A job with spread margins never permits flow outside of the field.
        if order.do is Do.ALLOW_OUTSIDE and order.value and self._job.field.margins:
            return Answer(False, "no_spread_margin")
        if (
            order.do is Do.REFILL
            # The tolerance of one step allows a hopper that was filled exactly.
            and (_read_number(order) or 0.0) > self._hopper_kg + REFILL_STEP_KG
        ):
            return Answer(
                False, make_refusal("refill_beyond_hopper", hopper_kg=f"{self._hopper_kg:g}")
            )
        if (
            order.do is Do.START
            and before in (State.READY, State.HELD)
            and (why := self._why_no_start())
        ):
            return Answer(False, why)
        # Safety decides last, after every reason of the job.
        answer = self._safety.handle_order(order, now_s)
        if not answer.accepted:
            return answer
        if order.do is Do.REFILL:
            # Effects follow only after acceptance, so that a refused order changes nothing.
            self.refilled = True
            self._flow_trim.record_refill(_read_number(order) or 0.0)
        elif order.do is Do.CALIBRATE and before is not State.CALIBRATING:
            self.bench = BenchSetting()
        elif order.do is Do.START and not held_down:
            self._started()
        return answer


def _read_number(order: Order) -> float | None:
    value = order.value
    return (
        float(value)
        # bool is a subclass of int, and True is no number here.
        if isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)
        else None
    )


_SWITCH_FIELDS = {
    Do.LOOK_AHEAD: "look_ahead",
    Do.FLOW_TRIM: "flow_trim_on",
    Do.NO_DOUBLE: "no_double",
}
_HANDLERS: Mapping[Do, Callable[[LoopOrderHandler, Order, float], Answer]] = {
    Do.STRATEGY: LoopOrderHandler._handle_strategy,
    Do.SOURCE: LoopOrderHandler._handle_source,
    Do.NUDGE: LoopOrderHandler._handle_nudge,
    Do.MANUAL_RATE: LoopOrderHandler._handle_manual_rate,
    **dict.fromkeys(_SWITCH_FIELDS, LoopOrderHandler._handle_switch),
    Do.STRIP: LoopOrderHandler._handle_strip,
    Do.DOSE_ERROR: LoopOrderHandler._handle_dose_error,
    Do.CALIBRATE_SHAFT: LoopOrderHandler._handle_bench_setting,
    Do.CALIBRATE_OPENING: LoopOrderHandler._handle_bench_setting,
    Do.SECTION: LoopOrderHandler._handle_section,
    Do.MARK: LoopOrderHandler._handle_mark,
    Do.REFILL_BACK: LoopOrderHandler._handle_refill_back,
}
