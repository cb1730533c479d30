"""A machine at work, stage after stage on a step of about 3 ms: what each sensor would say if
it had no noise.

Written from the published description of the machine, with mathematical forms of its own (see
shapes.py).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from . import nominal as nom
from . import shapes
from .kernels import chase, drag, slew
from .nominal import Effect, Physics
from .programmes import Drive
from .terms import ANGLE

Floats = npt.NDArray[np.float64]
SUBSTEPS = {0.05: 16, 0.1: 32}
_GATE = ("gate.", "x.gate", "t.gate", "y.gate")
_SHAFT = ("shaft.", "x.shaft", "t.shaft", "y.shaft")


class Plant:
    """Simulates one drive under any physics and effects; remembers gate and shaft, which most
    effects leave alone."""

    def __init__(self, drive: Drive, columns: dict[str, Floats] | None = None) -> None:
        """`columns`: further variables (rows,) that a term may depend on."""
        self.drive, self.columns = drive, columns or {}
        self.substeps = SUBSTEPS.get(round(drive.row_s, 6), 16)
        self.dt_s = drive.row_s / self.substeps
        rows = drive.time_s.size
        self.fine_s = drive.time_s[0] + self.dt_s * (np.arange(rows * self.substeps) + 0.5)
        self._kept: dict[Any, Any] = {}

    def run(self, physics: Physics, effects: Iterable[Effect] = ()) -> dict[str, Floats]:
        """Noise-free readings a row: shaft (r/min), gate (mm), scale (kg), wheel, gnss (m/s),
        heads (6, rows).

        True values ride along under `true_*`: true_shaft, true_gate, true_flow (kg/s, mean of
        the row to come).
        """
        some = tuple(effects)
        opening = self._gate(physics, some)
        shaft = self._shaft(physics, some, opening)
        flow = self._flow(physics, some, shaft, opening)
        wheel, gnss = self._speeds(physics, some)
        return {
            "shaft": self._shaft_reading(shaft, some),
            "gate": self._gate_reading(opening, some),
            "scale": self._scale(physics, some, flow),
            "wheel": wheel,
            "gnss": gnss,
            "heads": self._heads(physics, some),
            "true_shaft": self._at_rows(shaft),
            "true_gate": self._at_rows(opening),
            "true_flow": flow.reshape(-1, self.substeps).mean(axis=1),
        }

    # -- helpers
    # ----------------------------------------------------------------------------------------------

    def _at_rows(self, fine: Floats) -> Floats:
        """The state at each row's time stamp: what the last step before it left."""
        return np.r_[fine[0], fine[self.substeps - 1 : -1 : self.substeps]]

    def fine(self, name: str) -> Floats:
        """A row variable of the drive on the fine grid."""
        if name not in self._kept:
            rows = (
                self.columns[name] if name in self.columns else getattr(self.drive, name)
            ).astype(float)
            if name == "heading_deg":
                rows = np.unwrap(rows, period=360.0)
            self._kept[name] = np.interp(self.fine_s, self.drive.time_s, rows)
        out: Floats = self._kept[name]
        return out

    def _size(self, e: Effect) -> Any:
        """Its size, or (steps,) on the fine grid where it comes and goes."""
        return e.size if e.course is None else e.size * e.course.at(self.fine_s)

    def _size_at_rows(self, e: Effect) -> Any:
        return e.size if e.course is None else e.size * e.course.at(self.drive.time_s)

    def _term(self, e: Effect, own: dict[str, Floats]) -> Any:
        """Size times signal on the fine grid. `own`: variables that the stage itself knows
        better than the drive."""
        term = e.term
        assert term is not None
        values = {v: own[v] if v in own else self.fine(v) for v in {*term.variables, "time_s"}}
        return self._size(e) * term.signal(values, self.dt_s)

    def _delayed(self, rows: Floats, delay_s: Any) -> Floats:
        """Commands (rows,), each in force until the next row, seen `delay_s` later: exact mean
        over each fine step."""
        t0, step = self.drive.time_s[0], self.drive.row_s
        edges = np.r_[t0 - 30.0, t0 + step * np.arange(rows.size + 1)]
        total = np.r_[-30.0 * rows[0], 0.0, np.cumsum(rows) * step]
        if np.ndim(delay_s):
            first = t0 + self.dt_s * np.arange(self.fine_s.size) - delay_s
            return (
                np.asarray(
                    np.interp(first + self.dt_s, edges, total) - np.interp(first, edges, total)
                )
                / self.dt_s
            )
        at = t0 + self.dt_s * np.arange(self.fine_s.size + 1) - delay_s
        return np.diff(np.interp(at, edges, total)) / self.dt_s

    # -- stages
    # ----------------------------------------------------------------------------------------------

    def _gate(self, p: Physics, effects: tuple[Effect, ...]) -> Floats:
        mine = tuple(e for e in effects if e.id.startswith(_GATE) and e.id != "gate.offset")
        key = ("gate", p.gate_dead_s, p.gate_slew_mm_s, p.opening_off_mm, mine)
        if key in self._kept:
            return self._kept[key]  # type: ignore[no-any-return]
        rows = self.drive.opening_mm_cmd
        speed: Any = p.gate_slew_mm_s
        wanted = self._delayed(rows, p.gate_dead_s)
        for e in mine:
            if e.id == "gate.slow":
                speed = speed - self._size(e)
        motor = slew(wanted, speed + np.zeros(wanted.size), self.dt_s, float(rows[0]))
        x = motor + p.opening_off_mm
        for e in mine:
            if e.id == "gate.home_error":
                x = x + self._size(e)
            elif e.id == "gate.backlash":
                x = drag(x, self._size(e) / 2.0 + np.zeros(x.size), float(x[0]))
            elif e.id == "gate.lost_steps":
                moved = np.abs(np.diff(motor, prepend=motor[0]))
                if e.course is not None:
                    moved = moved * e.course.at(self.fine_s)
                share = np.cumsum(moved) / 100.0
                if e.form % 2:
                    share = np.floor(share / 0.5) * 0.5  # lost in slips rather than evenly
                x = x - e.size * share
            elif e.id == "gate.stuck":
                at = int(np.searchsorted(self.fine_s, e.onset_s or 0.0))
                x = np.where(np.arange(x.size) >= at, x[min(at, x.size - 1)], x)
            elif e.id == "x.gate_supply":
                x = x + e.size * (self.fine("supply_v") - nom.NOMINAL_SUPPLY_V)
            elif e.id == "x.gate_roll":
                x = x + e.size * self.fine("roll_deg")
            elif e.id == "t.gate_bow":
                x = x + e.size * np.sin(2 * np.pi * x / (17.0 + 10.0 * e.knob))
            elif e.id == "y.gate":
                x = x + self._term(e, {"opening_mm_cmd": wanted})
        x = np.clip(x, 0.0, nom.FULL_OPENING_MM + 2.0)
        return self._keep(key, x)

    def _keep(self, key: Any, x: Floats) -> Floats:
        if len(self._kept) > 24:
            for old in [k for k in self._kept if isinstance(k, tuple)][:8]:
                del self._kept[old]
        self._kept[key] = x
        return x

    def _gate_reading(self, opening: Floats, effects: tuple[Effect, ...]) -> Floats:
        y = self._at_rows(opening)
        for e in effects:
            if e.id == "gate.offset":
                y = y + self._size_at_rows(e)
        return y

    def _shaft(self, p: Physics, effects: tuple[Effect, ...], opening: Floats) -> Floats:
        mine = tuple(e for e in effects if e.id.startswith(_SHAFT))
        gate = (
            tuple(e for e in effects if e.id.startswith(_GATE))
            if any("droop" in e.id for e in mine)
            else ()
        )
        key = (
            "shaft",
            p.shaft_ratio,
            p.shaft_dead_s,
            p.shaft_tau_s,
            mine,
            gate,
            p.opening_off_mm if gate else 0.0,
        )
        if key in self._kept and not any("droop" in e.id for e in mine):
            return self._kept[key]  # type: ignore[no-any-return]
        dead = p.shaft_dead_s + sum(self._size(e) for e in mine if e.id == "shaft.dead_time")
        u = self._delayed(self.drive.shaft_rpm_cmd, dead)
        tau = np.full(u.size, p.shaft_tau_s)
        second: Any = 0.0
        factor: Any = p.shaft_ratio
        added: Any = None
        for e in mine:
            size = self._size(e)
            if e.id == "shaft.gain":
                factor = factor * (1 + size / 100)
            elif e.id == "shaft.slow":
                if e.form % 3 == 2:
                    tau, second = tau + 0.85 * size, 0.15 * size
                elif e.form % 3 == 1:
                    tau = tau + size * (0.85 + 0.3 * u / 70.0 * e.knob)
                else:
                    tau = tau + size
            elif e.id == "shaft.dead_band":
                u = np.where(u < size, 0.0, u)
            elif e.id == "shaft.voltage_sag":
                below = shapes.sag(self.fine("supply_v"), nom.NOMINAL_SUPPLY_V, e.form, e.knob)
                factor = factor * (1 - size / 100 * below)
            elif e.id == "shaft.load_droop":
                factor = factor * (1 - size / 100 * shapes.droop(opening, e.form, e.knob))
            elif e.id == "shaft.stall":
                factor = factor * (1 - shapes.begun(self.fine_s, e.onset_s))
            elif e.id == "x.shaft_heading":
                factor = factor * (
                    1 + e.size / 100 * np.cos(np.radians(self.fine("heading_deg") - 360 * e.knob))
                )
            elif e.id == "x.shaft_day":
                day = self.fine_s / self.fine_s[-1] * (1.2 + e.knob) + e.knob
                factor = factor * (1 + e.size / 100 * np.sin(2 * np.pi * day))
            elif e.id == "t.shaft_tau":
                tau = tau * np.maximum(0.2, 1 + e.size * (u - 50.0) / 50.0)
            elif e.id == "y.shaft" and e.term is not None and e.term.variables != (ANGLE,):
                factor = factor * (1 + self._term(e, {"shaft_rpm_cmd": u}) / 100)
            elif e.id == "y.shaft_rpm":
                added = self._term(e, {"shaft_rpm_cmd": u}) * (u > 0.0)
        aim = u * factor if added is None else np.maximum(0.0, u * factor + added)
        n = chase(aim, tau, nom.SHAFT_ACCELERATION_RPM_S, self.dt_s, float(u[0]))
        if np.any(second > 0.0):
            n = chase(n, np.maximum(np.full(u.size, 1e-6), second), 1e9, self.dt_s, float(u[0]))
        for e in mine:
            if e.id == "y.shaft" and e.term is not None and e.term.variables == (ANGLE,):
                n = n * (1 + self._term(e, {ANGLE: np.cumsum(n) * self.dt_s / 60.0}) / 100)
            if e.id == "t.shaft_ripple":
                angle = np.cumsum(n) * self.dt_s / 60.0
                n = n * (1 + e.size * np.sin(2 * np.pi * (angle + e.knob)))
        return self._keep(key, np.maximum(n, 0.0))

    def _shaft_reading(self, shaft: Floats, effects: tuple[Effect, ...]) -> Floats:
        y = self._at_rows(shaft)
        for e in effects:
            if e.id == "t.shaft_sensor":
                y = y + e.size * np.sin(y / (9.0 + 8.0 * e.knob)) * (y > 1.0)
            elif e.id == "shaft.coarse_encoder":
                y = np.where(self._size_at_rows(e) > 0.5 * e.size, np.round(y / e.size) * e.size, y)
        return y

    def _flow(
        self, p: Physics, effects: tuple[Effect, ...], shaft: Floats, opening: Floats
    ) -> Floats:
        """kg/s on the fine grid."""
        revs = shaft / 60.0
        per_rev = nom.FLOW_G_PER_REV_MM / 1000.0 * p.flow_ratio * opening
        extra: Any = 0.0
        factor: Any = 1.0
        t = self.fine_s
        mine = [e for e in effects if e.id.startswith(("flow.", "x.flow", "t.flow", "y.flow"))]
        for e in mine:
            size = self._size(e)
            s = size / 100.0
            if e.id == "flow.gain":
                factor = factor * (1 + s)
            elif e.id == "flow.zero_offset":
                fade = np.exp(-opening / 400.0) if e.form % 2 else 1.0
                per_rev = np.maximum(0.0, per_rev + size / 1000.0 * fade)
            elif e.id == "flow.fill_falloff":
                factor = factor * (1 - s * shapes.fill_loss(shaft, e.form, e.knob))
            elif e.id == "flow.moisture_drift":
                factor = factor * (1 + e.size / 100.0 * self._aged(e, t))
            elif e.id == "flow.batch":
                factor = factor * (1 + s * shapes.begun(t, self.refill_s))
            elif e.id == "flow.blocked_outlet":
                factor = factor * (
                    1 - s * (shapes.begun(t, e.onset_s) if e.course is None else 1.0)
                )
            elif e.id == "flow.bridging":
                factor = factor * (1 - shapes.spells(t, s, e.seed))
            elif e.id == "flow.leak":
                closing = np.exp(-shaft / 1.5) if e.form % 2 else (shaft < 0.5).astype(float)
                extra = extra + size / 3600.0 * closing
            elif e.id == "flow.slope":
                factor = factor * (1 + s * shapes.tilted(self.fine("pitch_deg"), e.form, e.knob))
            elif e.id == "x.flow_roll":
                factor = factor * (1 + s * self.fine("roll_deg"))
            elif e.id == "x.flow_vibration":
                v = self.fine("speed_mps")
                factor = factor * (1 + s * 4.0 * (v - 1.3))
            elif e.id == "t.flow_wave":
                far = np.cumsum(self.fine("speed_mps")) * self.dt_s
                factor = factor * (1 + e.size * np.sin(2 * np.pi * far / (40.0 + 30.0 * e.knob)))
            elif e.id == "y.flow":
                factor = factor * (
                    1 + self._term(e, {"shaft_rpm_cmd": shaft, "opening_mm_cmd": opening}) / 100.0
                )
        flow = per_rev * revs * factor + extra
        for e in mine:
            if e.id == "flow.hopper_head":
                flow = self._with_head(p, flow, e)
        return np.asarray(flow)

    def _aged(self, e: Effect, t: Floats) -> Floats:
        """Hours since it began (see shapes.aged)."""
        if e.course is None:
            return shapes.aged(t, e.form, e.knob)
        since, late = np.maximum(0.0, t - e.course.from_s), t >= e.course.from_s
        out = np.zeros_like(t)
        out[late] = shapes.aged(since[late], e.form, e.knob)
        return out

    def _with_head(self, p: Physics, flow: Floats, e: Effect) -> Floats:
        """The loss depends on the level and the level on the loss: three rounds of substitution
        settle it."""
        poured = np.repeat(self.drive.refill_kg_s, self.substeps)
        out = flow
        for _ in range(3):
            level = self.drive.start_kg - np.cumsum(out - poured) * self.dt_s
            out = flow * (
                1 - e.size / 100.0 * shapes.emptied(level / nom.FULL_HOPPER_KG, e.form, e.knob)
            )
        return out

    @property
    def refill_s(self) -> float:
        """When the product in the hopper changed (end of pouring); 1e12 without a refill."""
        poured = np.flatnonzero(self.drive.refill_kg_s > 0)
        return float(self.drive.time_s[poured[-1]]) if poured.size else 1e12

    def _scale(self, p: Physics, effects: tuple[Effect, ...], flow: Floats) -> Floats:
        d, t = self.drive, self.drive.time_s
        poured = d.refill_kg_s * (
            (d.refill_kg + p.level_kg[1]) / d.refill_kg if d.refill_kg else 1.0
        )
        out = flow.reshape(-1, self.substeps).sum(axis=1) * self.dt_s
        level = d.start_kg - np.r_[0.0, np.cumsum(out - poured * d.row_s)[:-1]]
        reading = level + p.level_kg[0]
        for e in effects:
            s = self._size_at_rows(e) / 100.0
            if e.id == "scale.gain":
                bend = (
                    1.0 + 0.04 * (e.knob - 0.5) * (level / nom.FULL_HOPPER_KG - 0.5)
                    if e.form % 2
                    else 1.0
                )
                reading = reading + s * level * bend
            elif e.id == "scale.drift":
                reading = reading + e.size * self._aged(e, t)
            elif e.id == "scale.tilt":
                reading = reading + s * level * shapes.tilted(d.pitch_deg, e.form, e.knob)
            elif e.id == "x.scale_supply":
                reading = reading + e.size * (d.supply_v - nom.NOMINAL_SUPPLY_V)
            elif e.id == "x.scale_roll":
                reading = reading + s * level * d.roll_deg
            elif e.id == "y.scale":
                reading = reading + self._at_rows(self._term(e, {}))
        return np.asarray(reading)

    def _speeds(self, p: Physics, effects: tuple[Effect, ...]) -> tuple[Floats, Floats]:
        d = self.drive
        wheel, gnss = d.speed_mps * p.wheel_ratio, d.speed_mps.copy()
        for e in effects:
            s = self._size_at_rows(e) / 100.0
            if e.id == "speed.wheel_slip":
                steep = 0.04 + 0.08 * e.knob
                hill = (
                    np.exp(steep * d.pitch_deg)
                    if e.form % 2
                    else np.maximum(0.0, 1 + steep * d.pitch_deg)
                )
                wheel = wheel * (1 + s * d.working * hill)
            elif e.id == "speed.wheel_radius":
                wheel = wheel * (1 + s)
            elif e.id == "speed.missed_pulses":
                wheel = wheel * (1 - s)
            elif e.id == "speed.gnss_latency":
                late = self._late(gnss, e)
                gnss = late if e.course is None else gnss + e.course.at(d.time_s) * (late - gnss)
            elif e.id == "x.wheel_roll":
                wheel = wheel * (1 + s * d.roll_deg)
            elif e.id == "x.wheel_supply":
                wheel = wheel * (1 + s * (d.supply_v - nom.NOMINAL_SUPPLY_V))
            elif e.id == "t.wheel_wobble":
                wheel = wheel * (
                    1 + e.size * np.sin(2 * np.pi * np.cumsum(d.speed_mps) * d.row_s / 2.5)
                )
            elif e.id == "y.wheel":
                wheel = wheel * (1 + self._at_rows(self._term(e, {})) / 100.0)
        return wheel, gnss

    def _late(self, speed: Floats, e: Effect) -> Floats:
        t, lag = self.drive.time_s, e.size
        if e.form % 2 == 0:
            return np.interp(t - lag, t, speed)
        # part delay, part smoothing inside the receiver
        moved = np.interp(t - 0.7 * lag, t, speed)
        window = 0.6 * lag  # of a running mean, which delays by half of it
        if window <= self.drive.row_s:
            return np.interp(t - lag, t, speed)
        far = np.r_[0.0, np.cumsum((moved[1:] + moved[:-1]) / 2.0)] * self.drive.row_s
        return (far - np.interp(t - window, t, far)) / window

    def _heads(self, p: Physics, effects: tuple[Effect, ...]) -> Floats:
        out = self.drive.ndvi * np.asarray(p.heads_ratio)[:, None]
        for e in effects:
            if e.id == "canopy.head_fouled":
                out[(e.member or 1) - 1] *= 1 + self._size_at_rows(e) / 100.0
        return out
