"""Bench tables with something hidden in them: lag, catch, weigh, heads, place. Rows are few, so
all is plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import nominal as nom
from . import shapes
from .nominal import Effect

Floats = npt.NDArray[np.float64]
_DIGITS = {
    "lag_s": 3,
    "response_s": 3,
    "lag_m": 3,
    "mass_kg": 5,
    "applied_kg": 3,
    "ndvi": 4,
    "miss_m": 3,
}
KINDS = ("plain", "quantised", "tails")


class Layout(NamedTuple):
    """One way of laying out a bench test, of one half for good."""

    name: str
    split: str
    kind: str  # lag, catch, weigh, heads, place
    variant: str
    # shaft speeds (lag, catch, place), references (heads)
    values: tuple[float, ...]
    # speeds m/s (lag, place), openings (catch), minutes (heads), plots (weigh)
    others: tuple[float, ...]
    replicates: int


LAYOUTS: tuple[Layout, ...] = (
    Layout("lag_plain", "tuning", "lag", "lag_s", (10, 20, 30, 40, 50, 60, 70), (1.18,), 4),
    Layout("lag_far", "tuning", "lag", "lag_s", (10, 25, 40, 55, 70, 80, 90, 100), (1.18,), 4),
    Layout("lag_response", "tuning", "lag", "response_s", (10, 20, 30, 40, 50, 60, 70), (1.18,), 3),
    Layout("lag_starts", "tuning", "lag", "start", (20, 40, 60), (1.18,), 4),
    Layout("lag_directions", "tuning", "lag", "direction", (20, 40, 60), (1.18,), 4),
    Layout("lag_both", "tuning", "lag", "both", (10, 20, 30, 40, 50, 60, 70), (0.9, 1.5), 2),
    Layout("catch_grid", "tuning", "catch", "all", (20, 40, 60, 80, 100), (10, 25, 45), 2),
    Layout("catch_outlets", "tuning", "catch", "outlet", (40, 80), (15, 30), 3),
    Layout("catch_short", "tuning", "catch", "short", (20, 35), (20,), 2),
    Layout("weigh_plots", "tuning", "weigh", "plain", (), (12,), 1),
    Layout("heads_cold", "tuning", "heads", "all", (0.25, 0.4, 0.55, 0.7, 0.8), (0.5, 3, 8, 20), 1),
    Layout("heads_warm", "tuning", "heads", "all", (0.2, 0.35, 0.5, 0.65, 0.8), (), 3),
    Layout("place_one", "tuning", "place", "plain", (30, 60), (1.3,), 8),
    Layout("place_two", "tuning", "place", "plain", (30, 60), (0.9, 1.7), 6),
    Layout("lag_dense", "unseen", "lag", "lag_s", (10, 15, 22, 30, 38, 46, 54, 62, 70), (1.25,), 3),
    Layout("lag_wide", "unseen", "lag", "lag_s", (15, 30, 45, 60, 75, 85, 95, 100), (1.25,), 5),
    Layout("lag_shaft", "unseen", "lag", "response_s", (15, 30, 45, 60, 70), (1.25,), 5),
    Layout("lag_tube", "unseen", "lag", "start", (15, 35, 55, 70), (1.25,), 3),
    Layout("lag_up_down", "unseen", "lag", "direction", (15, 35, 55, 70), (1.25,), 3),
    Layout("lag_metres", "unseen", "lag", "both", (15, 30, 45, 60), (0.8, 1.3, 1.8), 2),
    Layout("catch_stairs", "unseen", "catch", "all", (15, 30, 50, 70, 85, 100), (12, 30, 50), 2),
    Layout("catch_each", "unseen", "catch", "outlet", (30, 60, 90), (20, 40), 2),
    Layout("catch_flutes", "unseen", "catch", "short", (15, 28), (25,), 2),
    Layout("weigh_strips", "unseen", "weigh", "plain", (), (9,), 1),
    Layout("heads_start", "unseen", "heads", "all", (0.3, 0.5, 0.65, 0.8), (1, 4, 10, 25), 1),
    Layout("heads_canopy", "unseen", "heads", "all", (0.2, 0.3, 0.45, 0.6, 0.75, 0.82), (), 3),
    Layout("place_single", "unseen", "place", "plain", (20, 40, 65), (1.5,), 6),
    Layout("place_speeds", "unseen", "place", "plain", (20, 45, 70), (0.8, 1.3, 1.9), 4),
)
SHOWS: dict[str, tuple[str, ...]] = {
    "lag_s": ("lag.offset", "lag.rebound", "lag.coarse_clock", "shaft.dead_time"),
    "response_s": ("shaft.dead_time",),  # the extra lag lies between shaft and ground
    "start": ("lag.first_fill", "lag.offset", "shaft.dead_time"),
    "direction": ("lag.asymmetry", "lag.offset", "shaft.dead_time"),
    "both": ("lag.speed_scale", "lag.offset", "shaft.dead_time"),
    "all": ("flow.gain", "flow.zero_offset", "flow.fill_falloff"),
    "outlet": ("flow.outlet_uneven", "flow.gain"),
    "short": ("flow.pulsation",),
}


def shown(layout: Layout) -> tuple[str, ...]:
    """Ids that a table of this layout can show."""
    if layout.kind == "weigh":
        return (
            "flow.gain",
            "flow.zero_offset",
            "speed.wheel_slip",
            "speed.wheel_radius",
            "scale.gain",
        )
    if layout.kind == "place":
        return ("place.lever_arm", "place.latency")
    if layout.kind == "heads":
        return ("canopy.head_fouled", "canopy.warm_up" if layout.others else "canopy.saturation")
    ids = SHOWS[layout.variant]
    return ids if max(layout.values) > 80 else tuple(i for i in ids if i != "lag.rebound")


class Table:
    """One bench test: given columns, the measured ones predicted for any effects, its noise and
    its nuisances."""

    def __init__(self, layout: Layout, rng: np.random.Generator) -> None:
        self.layout = layout
        self.given: dict[str, npt.NDArray[Any]] = {}
        self.measured: tuple[str, ...] = ()
        self.sd: Floats = np.zeros(0)
        getattr(self, f"_lay_{layout.kind}")(layout, rng)
        self.clock_s = 0.0  # of a detector that rounds the times
        self.base = self.predict(())

    def _cross(self, **axes: Sequence[Any]) -> None:
        names = list(axes)
        mesh = np.meshgrid(*[np.arange(len(axes[n])) for n in names], indexing="ij")
        for n, m in zip(names, mesh, strict=True):
            self.given[n] = np.array(axes[n])[m.ravel()]
        if "replicate" in self.given:
            self.given["replicate"] = self.given["replicate"].astype(float)

    def _lay_lag(self, lay: Layout, rng: np.random.Generator) -> None:
        axes: dict[str, Sequence[Any]] = {
            "replicate": range(1, lay.replicates + 1),
            "shaft_rpm": [float(v) for v in lay.values],
        }
        if lay.variant == "both":
            axes["speed_kmh"] = [round(3.6 * v, 2) for v in lay.others]
        if lay.variant == "start":
            axes["start"] = ["empty", "running"]
        if lay.variant == "direction":
            axes["direction"] = ["up", "down"]
        self._cross(**axes)
        self.measured = (
            ("lag_s", "lag_m")
            if lay.variant == "both"
            else ("response_s",)
            if lay.variant == "response_s"
            else ("lag_s",)
        )
        sd = rng.uniform(0.015, 0.06) * (0.3 if lay.variant == "response_s" else 1.0)
        rows = self.given["shaft_rpm"].size
        self.sd = np.full((len(self.measured), rows), sd)
        if lay.variant == "both":
            self.sd[1] = np.maximum(0.02, 0.5 * sd)

    def _lay_catch(self, lay: Layout, rng: np.random.Generator) -> None:
        axes: dict[str, Sequence[Any]] = {
            "replicate": range(1, lay.replicates + 1),
            "shaft_rpm": [float(v) for v in lay.values],
            "opening_mm": [float(v) for v in lay.others],
        }
        if lay.variant == "outlet":
            axes["outlet"] = [float(k) for k in range(1, nom.OUTLETS + 1)]
        axes["duration_s"] = (
            [round(0.1 + 0.07 * k, 2) for k in range(17)]
            if lay.variant == "short"
            else [float(rng.choice([30.0, 60.0]))]
        )
        self._cross(**axes)
        self.measured = ("mass_kg",)
        mass = self.predict(())
        self.sd = np.hypot(
            0.0004 if lay.variant == "short" else 0.002, rng.uniform(0.002, 0.006) * mass
        )

    def _lay_weigh(self, lay: Layout, rng: np.random.Generator) -> None:
        count = int(lay.others[0])
        rate = rng.choice([250.0, 300.0, 350.0], count)
        area = np.full(count, 600.0)
        self.given = {
            "plot": np.array([f"P{k + 1}" for k in range(count)]),
            "area_m2": area,
            "target_kg": np.round(rate * area / 1e4, 2),
        }
        self.measured = ("applied_kg",)
        self.sd = (rng.uniform(0.005, 0.012) * self.given["target_kg"])[None]

    def _lay_heads(self, lay: Layout, rng: np.random.Generator) -> None:
        axes: dict[str, Sequence[Any]] = {
            "head": [float(k) for k in range(1, nom.HEADS + 1)],
            "ndvi_reference": list(lay.values),
        }
        if lay.others:
            axes["warm_min"] = [float(m) for m in lay.others]
        self._cross(**axes, replicate=range(1, lay.replicates + 1))
        del self.given["replicate"]
        self.measured = ("ndvi",)
        self.sd = np.full((1, self.given["head"].size), 0.01 * rng.uniform(0.5, 1.2))

    def _lay_place(self, lay: Layout, rng: np.random.Generator) -> None:
        self._cross(
            replicate=range(1, lay.replicates + 1),
            shaft_rpm=[float(v) for v in lay.values],
            speed_mps=[float(v) for v in lay.others],
        )
        if rng.random() < 0.4:
            self.given["corrected_lag_s"] = np.zeros(self.given["shaft_rpm"].size)
        self.measured = ("miss_m",)
        self.sd = np.full((1, self.given["shaft_rpm"].size), rng.uniform(0.05, 0.15))

    # -- what would be measured
    # ------------------------------------------------------------------------------------

    def predict(self, effects: Sequence[Effect], shift: dict[str, float] | None = None) -> Floats:
        """Noise-free measured columns (columns, rows). `shift`: nuisances in their own units."""
        return np.atleast_2d(
            getattr(self, f"_{self.layout.kind}")({e.id: e for e in effects}, shift or {})
        )

    def nuisances(self) -> dict[str, float]:
        """Name -> prior s.d."""
        kind = self.layout.kind
        if kind in ("lag", "place"):
            return {"dead_s": 0.010}
        if kind == "catch":
            return {"flow": 0.001, "opening_mm": 0.01}
        if kind == "heads":
            return {f"head{k}": nom.HEAD_TOLERANCE for k in range(1, nom.HEADS + 1)}
        return {"flow": 0.001, "wheel": 0.0005}

    def _lag(self, has: dict[str, Effect], shift: dict[str, float]) -> Floats:
        n = self.given["shaft_rpm"]
        response = np.full(n.size, nom.RESPONSE_S + shift.get("dead_s", 0.0))
        drop = nom.DROP_INTERCEPT_S + nom.DROP_SLOPE_S_PER_RPM * n
        t = response if self.measured == ("response_s",) else response + drop
        for e in has.values():
            if e.id in ("lag.offset", "shaft.dead_time"):
                t = t + e.size
            elif e.id == "lag.rebound":
                foot = (70.0, 60.0)[e.form % 2]
                t = t + e.size * (np.maximum(0.0, n - foot) / (100.0 - foot)) ** (
                    1.0 + 0.8 * e.knob
                )
            elif e.id == "lag.first_fill" and "start" in self.given:
                t = t + e.size * (self.given["start"] == "empty")
            elif e.id == "lag.asymmetry" and "direction" in self.given:
                down = self.given["direction"] == "down"
                # rising ones: nominal, or nearly
                t = t + e.size * (down - 0.1 * e.knob * (e.form % 2))
            elif e.id == "x.lag_hump":
                t = t + e.size * shapes.hump(n, 28.0 + 20.0 * e.knob, 9.0)
            elif e.id == "x.lag_tiring":
                t = t + e.size * shapes.trend(self.given["replicate"])
            elif e.id == "x.lag_ground_speed":
                t = t + e.size * (self.given["speed_kmh"] / 3.6 - 1.2)
        if "lag_m" not in self.measured:
            return t
        s = has["lag.speed_scale"].size / 100.0 if "lag.speed_scale" in has else 0.0
        return np.array([t, t * self.given["speed_kmh"] / 3.6 * (1 + s)])

    def _catch(self, has: dict[str, Effect], shift: dict[str, float]) -> Floats:
        n, o, duration = (self.given[k] for k in ("shaft_rpm", "opening_mm", "duration_s"))
        g_rev = (
            nom.FLOW_G_PER_REV_MM
            * (1 + shift.get("flow", 0.0))
            * (o + shift.get("opening_mm", 0.0))
        )
        turns = n / 60.0 * duration
        factor: Any = 1.0 / nom.OUTLETS if "outlet" in self.given else 1.0
        for e in has.values():
            s = e.size / 100.0
            if e.id == "flow.gain":
                factor = factor * (1 + s)
            elif e.id == "flow.zero_offset":
                g_rev = np.maximum(
                    0.0, g_rev + e.size * (np.exp(-o / 400.0) if e.form % 2 else 1.0)
                )
            elif e.id == "flow.fill_falloff":
                factor = factor * (1 - s * shapes.fill_loss(n, e.form, e.knob))
            elif e.id == "flow.outlet_uneven" and "outlet" in self.given:
                factor = factor * (1 + s * (self.given["outlet"] == e.member))
            elif e.id == "flow.pulsation":
                phase = 2 * np.pi * e.knob
                w = 2 * np.pi * nom.FLUTES
                turns = turns + s * (np.cos(phase) - np.cos(phase + w * turns)) / w
            elif e.id == "x.catch_resonance":
                factor = factor * (1 + s * shapes.hump(n, 45.0 + 15.0 * e.knob, 14.0))
            elif e.id == "x.catch_waist":
                factor = factor * (1 + s * shapes.hump(o, 25.0 + 5.0 * e.knob, 8.0))
            elif e.id == "x.catch_packing":
                factor = factor * (1 + s * shapes.trend(self.given["replicate"]))
        return np.asarray(g_rev * turns * factor / 1000.0)

    def _weigh(self, has: dict[str, Effect], shift: dict[str, float]) -> Floats:
        factor = 1 + shift.get("flow", 0.0) + shift.get("wheel", 0.0)
        for e in has.values():
            if e.id == "flow.zero_offset":  # at 25 mm, where these plots were sown
                factor *= 1 + e.size / (nom.FLOW_G_PER_REV_MM * 25.0)
            else:
                factor *= 1 + e.size / 100.0
        return np.asarray(self.given["target_kg"] * factor)

    def _heads(self, has: dict[str, Effect], shift: dict[str, float]) -> Floats:
        r, head = self.given["ndvi_reference"], self.given["head"]
        y = r * (1 + np.array([shift.get(f"head{int(h)}", 0.0) for h in head]))
        for e in has.values():
            s = e.size / 100.0
            if e.id == "canopy.head_fouled":
                y = y * (1 + s * (head == e.member))
            elif e.id == "canopy.warm_up" and "warm_min" in self.given:
                minutes = self.given["warm_min"]
                y = y * (
                    1
                    + s
                    * (
                        np.exp(-minutes / (3.0 + 4.0 * e.knob))
                        if e.form % 2 == 0
                        else 1.0 / (1.0 + minutes / (2.5 + 3.0 * e.knob)) ** 2
                    )
                )
            elif e.id == "canopy.saturation":
                power = 2.0 + 2.0 * e.knob
                loss = (
                    (r / 0.8) ** power
                    if e.form % 2 == 0
                    else np.maximum(0.0, (r - 0.35) / 0.45) ** (0.5 * power)
                )
                y = y * (1 - s * loss)
            elif e.id == "x.heads_hump":
                y = y + e.size * shapes.hump(r, 0.45 + 0.1 * e.knob, 0.1)
            elif e.id == "x.heads_swing" and "warm_min" in self.given:
                y = y * (
                    1 + s * shapes.hump(np.log(self.given["warm_min"]), 1.7 + 0.5 * e.knob, 0.6)
                )
        return np.asarray(y)

    def _place(self, has: dict[str, Effect], shift: dict[str, float]) -> Floats:
        v, n = self.given["speed_mps"], self.given["shaft_rpm"]
        miss = v * shift.get("dead_s", 0.0)
        if "corrected_lag_s" in self.given:
            miss = miss + v * (nom.RESPONSE_S + nom.DROP_INTERCEPT_S + nom.DROP_SLOPE_S_PER_RPM * n)
        for e in has.values():
            if e.id == "x.place_speeding":
                miss = miss + e.size * (n - 45.0) / 20.0
            elif e.id == "x.place_tiring":
                miss = miss + e.size * (shapes.trend(self.given["replicate"]) - 0.5)
            else:
                miss = miss + (e.size if e.id == "place.lever_arm" else v * e.size)
        return np.asarray(miss)

    # -- how visible
    # ----------------------------------------------------------------------------------------------

    def trace(self, effects: Sequence[Effect], beside: Sequence[Effect] = ()) -> Floats:
        """Difference in units of noise, nuisances projected under their priors (rows +
        nuisances,)."""
        noise = self._noise_sd()
        d = ((self.predict((*beside, *effects)) - self.predict(beside)) / noise).ravel()
        j = np.array(
            [
                ((self.predict((), {k: sd}) - self.base) / noise).ravel()
                for k, sd in self.nuisances().items()
            ]
        )
        theta = np.linalg.solve(j @ j.T + np.eye(len(j)), j @ d)
        return np.r_[d - theta @ j, theta]

    def _noise_sd(self) -> Floats:
        """Noise of the rows and what a coarse clock adds to it: replicates share its rounding."""
        shared = self.layout.replicates * self.clock_s**2 / 12.0
        timed = np.array([[name != "lag_m"] for name in self.measured])
        return np.asarray(np.sqrt(self.sd**2 + shared * timed))

    def observed(
        self, effects: Sequence[Effect], noise: str, rng: np.random.Generator
    ) -> dict[str, npt.NDArray[Any]]:
        """The table as measured: given columns and noisy ones."""
        shift = {k: sd * rng.normal() for k, sd in self.nuisances().items()}
        clean = self.predict(effects, shift)
        draws = (
            rng.standard_t(4.0, clean.shape) / np.sqrt(2.0)
            if noise == "tails"
            else rng.normal(size=clean.shape)
        )
        y = clean + self.sd * draws
        clock = next((e.size for e in effects if e.id == "lag.coarse_clock"), None)
        out = {
            k: v.astype(object) if v.dtype.kind == "U" else v.astype(float)
            for k, v in self.given.items()
        }
        for name, row in zip(self.measured, y, strict=True):
            digits = _DIGITS[name] - (noise == "quantised")
            if clock is not None and name != "lag_m":
                row = np.round(row / clock) * clock
            out[name] = np.round(row, digits)
        if noise != "tails":
            return out
        # rows that somebody failed to write down
        kept = rng.random(y.shape[1]) > rng.uniform(0.0, 0.08)
        return {k: v[kept] for k, v in out.items()} if kept.sum() >= 0.8 * kept.size else out
