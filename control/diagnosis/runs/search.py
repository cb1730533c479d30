"""One group of coupled channels: its hypotheses scanned by columns and refitted through the model."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis import effects
from control.diagnosis.effects import ROWS, FoundBy
from control.machine.machine import CATALOGUE, Machine
from control.machine.over_log import MOST_STEP_S

from . import noise as noises
from .channels import FINE_S, Channel
from .hypothesis import Part, Parts, bounds, schedule, stages_of
from .likelihood import Z90, Column, Fit, Problem, best_fitted, calm, fitted, problem, projected, solved
from .noise import Noise, coefficients, series_of
from .nuisances import (
    FORM_CHANNEL,
    Candidate,
    Nuisance,
    candidates,
    nuisances,
    stamp_sd_s,
)
from .robust import tail_excess
from .smooth import TABLES, series, span
from .stages import RunData

Array = npt.NDArray[np.float64]

FORM_SHARE = 0.25           # of an effect's own signal that its form may be wrong by
RIVAL_FORM_SHARE = 0.1      # the same where names are held against each other
ROUNDS = 4
SETTLE_ROUNDS = 4
TRAIT_SHARE = 0.5           # of a tolerance, by which it may differ from case to case within one machine
REFILL_SD_KG = 0.5          # of what the operator wrote down
HALT_S = 3.0                # around a drive's halt: how it runs down is nobody's effect
OUTLIER = 4.5
ANSWERED_S = 2.0            # after a command, a drive has answered it
FITTED_FROM = 4.0           # of twice the log-likelihood under a given noise, from which on the noise is fitted too
DEAD_TIME_HALVINGS = 5      # of its tolerance, when a dead time is looked for
DIPS_WITHIN_S = 0.5         # a pulse that goes missing shows in rows of this length
ROUNDING_SHARE = 0.1        # of an encoder's step: how well the mean error of rounding is known
THRESHOLDS_TRIED = 16       # places of a threshold, over all commands
THRESHOLD_GAP = 2.7         # of twice the log-likelihood: 90 % for one size


class Found(NamedTuple):
    """A candidate as the scan sees it."""

    part: Part                  # with the estimated size
    gain: float                 # of twice the log-likelihood


class Refit(NamedTuple):
    """A hypothesis refitted in full."""

    parts: Parts
    sd: tuple[float, ...]       # of the sizes
    log_likelihood: float
    noise: dict[str, Noise]
    tangled: float = 0.0        # largest correlation between two sizes


class Group:
    """Channels that share effects, under any hypothesis about them."""

    def __init__(self, channels: Sequence[Channel], machine: Machine, data: RunData) -> None:
        self.channels = tuple(channels)
        self.names = tuple(channel.name for channel in channels)
        self.machine = machine
        self.data = data
        self.base = stages_of(machine)
        self.noise = {c.name: noises.start(c.prior) for c in channels}
        self._predictions: dict[Parts, dict[str, Array]] = {}
        self._excess: dict[str, Array] = {c.name: np.zeros(len(c.measured)) for c in channels}
        heads = 0 if data.heads is None else int(np.isfinite(data.heads.ndvi).any(axis=1).sum())
        refilled = data.hopper is not None and bool(data.hopper.jumps)
        self.candidates = [c for c in candidates(self.names, heads, refilled) if _excited(c, data)]
        self._heads = heads
        self._off: dict[str, float] = {}
        self._sought: set[str] = set()      # thresholds that were looked for all over
        self._fixed = self._nuisance_columns()
        if "scale" in self.names and data.hopper is not None:
            level = channels[self.names.index("scale")]
            seen = np.interp(data.time_s, level.grid.even_s, self.predicted(())["scale"])
            self.data = data = data._replace(variables={**data.variables, "hopper_kg": seen})
        self._units = {stage: self._unit(part) for stage, (_, part) in TABLES.items()
                       if FORM_CHANNEL[stage] in self.names and stage != "scale"}
        self._forms: dict[tuple[str, str], list[Column]] = {}
        self._tried: dict[tuple[Parts, str], Column] = {}

    def channel(self, name: str) -> Channel:
        """One of the group's channels; ValueError where it has none of that name."""
        return self.channels[self.names.index(name)]

    # -- through the model ---------------------------------------------------------------------------------------

    def predicted(self, parts: Parts) -> dict[str, Array]:
        if parts not in self._predictions:
            if len(self._predictions) > 24:
                self._predictions.pop(next(iter(self._predictions)))
            plan = schedule(self.base, parts)
            self._predictions[parts] = {c.name: c.predict(plan, MOST_STEP_S) for c in self.channels}
        return self._predictions[parts]

    def residual(self, parts: Parts) -> dict[str, Array]:
        now = self.predicted(parts)
        left = {c.name: c.measured - self._excess[c.name] - now[c.name] for c in self.channels}
        for part in parts:
            if CATALOGUE[part.id].effect.onset_only and part.onset_s is not None:
                channel = self.channel(ROWS[part.id].stage)
                after_s = channel.grid.even_s - part.onset_s
                left[channel.name] = np.where((after_s > -HALT_S) & (after_s < HALT_S), 0.0, left[channel.name])
        return left

    def _touched(self, effect_id: str) -> tuple[str, ...]:
        on = ROWS[effect_id].channels
        return tuple(n for n in on if n in self.names) if len(on) > 1 else on

    def difference(self, parts: Parts, more: Part) -> dict[str, Array]:
        """What one more part does to the channels that it touches."""
        touched = self._touched(more.id)
        now = self.predicted(parts)
        plan = schedule(self.base, (*parts, more))
        return {c.name: c.predict(plan, MOST_STEP_S) - now[c.name] for c in self.channels if c.name in touched}

    def column(self, key: str, parts_series: dict[str, Array], sd: float = np.inf) -> Column:
        cuts = {c.name: c.cut for c in self.channels}
        return Column(key, {name: coefficients(one, cuts[name]) for name, one in parts_series.items()}, sd)

    def _unit(self, part: Part) -> Array:
        size = ROWS[part.id].probe
        assert size is not None
        return self.difference((), part._replace(size=size))[self._touched(part.id)[0]] / size

    def settle(self, parts: Parts) -> Parts:
        """Nominal values moved, within their tolerances, to where they fit best: their slopes are then taken there.

        The parts' sizes move along, for a size and a tolerance may stand for the same thing; they are returned.
        """
        self._try_dead_times(parts)
        best = self._at_rest(parts)
        for _ in range(SETTLE_ROUNDS):
            before = dict(self._off)
            p, count = self.compressed(parts)
            amplitude = fitted(p, np.arange(count), self.noise, rounds=3).amplitude
            step = {n.key: (n, amplitude[p.keys.index(n.key)]) for c in self.channels
                    for n in nuisances(c.name, self.machine)}
            sizes = {int(key.split()[1]): amplitude[k] for k, key in enumerate(p.keys) if key.startswith("slope ")}
            if all(abs(size) < 0.05 * n.sd for n, size in step.values()):
                break
            tried = parts
            for share in (1.0, 0.4, 0.15):
                self._move({key: float(np.clip(before.get(key, 0.0) + share * size, -3.0 * n.sd, 3.0 * n.sd))
                            for key, (n, size) in step.items()})
                tried = tuple(_grown(part, share * sizes.get(k, 0.0)) for k, part in enumerate(parts))
                now = self._at_rest(tried)
                if now > best:
                    break
            if now <= best:
                self._move(before)
                break
            gained, best, parts = now - best, now, tried
            if gained < 0.5:
                break
        return parts

    def _try_dead_times(self, parts: Parts) -> None:
        """Dead times moved to the best of a grid: rows see only the end of a short move, so slopes lead nowhere.

        A move shorter than a row is over before it is read, or has not begun: the likelihood has kinks there.
        """
        for channel in self.channels:
            for n in nuisances(channel.name, self.machine):
                if n.field == "dead_time_s":
                    self._move_dead_time(parts, channel, n)

    def _move_dead_time(self, parts: Parts, channel: Channel, n: Nuisance) -> None:
        kept = [c for c in self._fixed if c.key != n.key and channel.name in c.coefficients]
        nominal = getattr(getattr(self.machine, n.stage), n.field)
        places = np.arange(len(kept))

        def value(off: float) -> float:
            plan = schedule(self.base.put(n.stage, **{n.field: float(nominal + off)}), parts)
            left = channel.measured - self._excess[channel.name] - channel.predict(plan, MOST_STEP_S)
            p = problem([channel], {channel.name: coefficients(left, channel.cut)}, kept)
            return fitted(p, places, self.noise, rounds=2).log_likelihood - 0.5 * (off / n.sd) ** 2
        now = self._off.get(n.key, 0.0)
        tried = {now: value(now)}
        step = n.sd
        for off in now + step * np.arange(-2.0, 3.0):
            if abs(off) <= 3.0 * n.sd:
                tried[float(off)] = value(float(off))
        for _ in range(DEAD_TIME_HALVINGS):
            step *= 0.5
            middle = max(tried, key=lambda off: tried[off])
            for off in (middle - step, middle + step):
                tried.setdefault(off, value(off))
        best = max(tried, key=lambda off: tried[off])
        if tried[best] > tried[now] + 2.0:
            self._move({**self._off, n.key: best})

    def unsettle(self) -> None:
        """Nominal values back to the machine file's: what they took upon themselves may be an effect's."""
        self._move({})

    def _at_rest(self, parts: Parts) -> float:
        """Log-likelihood with the nominal values exactly where they stand."""
        data = self.data_of(parts)
        kept = [c for c in self._fixed if not any(c.key.startswith(key) for key in self._tolerances)]
        p = problem(self.channels, data, kept)
        value = fitted(p, np.arange(len(kept)), self.noise, rounds=2).log_likelihood
        for c in self.channels:
            for n in nuisances(c.name, self.machine):
                value -= 0.5 * (self._off.get(n.key, 0.0) / n.sd) ** 2
        return value

    @property
    def _tolerances(self) -> tuple[str, ...]:
        return tuple(n.key for c in self.channels for n in nuisances(c.name, self.machine))

    def _move(self, off: dict[str, float]) -> None:
        for channel in self.channels:
            for n in nuisances(channel.name, self.machine):
                nominal = getattr(getattr(self.machine, n.stage), n.field)
                self.base = self.base.put(n.stage, **{n.field: float(nominal + off.get(n.key, 0.0))})
        self._off = dict(off)
        self._predictions.clear()
        self._tried.clear()
        self._fixed = self._nuisance_columns()

    def _nuisance_columns(self) -> list[Column]:
        found: list[Column] = []
        now = self.predicted(())
        for channel in self.channels:
            for n in nuisances(channel.name, self.machine):
                value = getattr(self.base.by_name[n.stage], n.field) + n.step
                plan = schedule(self.base.put(n.stage, **{n.field: value}), ())
                change = (channel.predict(plan, MOST_STEP_S) - now[channel.name]) / n.step
                column = self.column(n.key, {channel.name: change}, n.sd)
                found.append(column._replace(mean=-self._off.get(n.key, 0.0)))
                if channel.name == "shaft" and n.field != "gain_percent":
                    found += self._by_speed_and_way(n.key, change, now["shaft"], TRAIT_SHARE * n.sd)
            if channel.name == "shaft" and self.data.shaft is not None and self.data.shaft.step > 0.0:
                turning = (now["shaft"] > self.data.shaft.step).astype(np.float64)
                found.append(self.column("rounding", {"shaft": turning}, ROUNDING_SHARE * self.data.shaft.step))
            if channel.name == "scale" and self.data.hopper is not None:
                count = len(channel.measured)
                found.append(self.column("level", {"scale": np.ones(count)}, 20.0))
                for k, jump in enumerate(self.data.hopper.jumps):
                    after = channel.grid.of((np.arange(len(self.data.hopper.reading_kg)) >= jump).astype(np.float64))
                    sd = REFILL_SD_KG if self.data.hopper.told[k] else 20.0
                    found.append(self.column(f"refill {k}", {"scale": after}, sd))
            if channel.name == "speed":
                late = self.difference((), Part(effects.SPEED_GNSS_LATENCY.id, 2.0 * FINE_S))
                stamp = {name: series / (2.0 * FINE_S) for name, series in late.items()}
                found.append(self.column("gnss stamp", stamp, stamp_sd_s(self.machine, channel.grid.step_s)))
            if channel.name == "heads":
                for k in range(self._heads):
                    one = self.difference((), Part(effects.CANOPY_HEAD_FOULED.id, 1.0, None, k + 1))
                    found.append(self.column(f"head {k + 1}", one, self.machine.tolerance.head_percent))
        return found

    def _by_speed_and_way(self, key: str, change: Array, rpm: Array, sd: float) -> list[Column]:
        """The same tolerance, unlike at low and high speed and for rising and falling commands."""
        middle, half = 0.5 * float(rpm.max() + rpm.min()), 0.5 * float(np.ptp(rpm)) + 1e-9
        way = np.sign(np.gradient(rpm))
        return [self.column(f"{key} by speed", {"shaft": change * (rpm - middle) / half}, sd),
                self.column(f"{key} by way", {"shaft": change * way}, sd)]

    def forms(self, stage: str, variable: str) -> list[Column]:
        """Columns of the smooth shapes of a stage over a variable (empty: the variable hardly moves)."""
        if (stage, variable) not in self._forms:
            self._forms[(stage, variable)] = self._made_forms(stage, variable, self.data)
        return self._forms[(stage, variable)]

    def moved_forms(self, stage: str, variable: str, share: float) -> list[Column]:
        """The same with the variable moved along the log by a share of it, round the end."""
        moved = np.roll(self.data.variables[variable], round(share * len(self.data.time_s)))
        return self._made_forms(stage, variable, self.data._replace(variables={**self.data.variables, variable: moved}))

    def _made_forms(self, stage: str, variable: str, data: RunData) -> list[Column]:
        over, name = span(data, variable), FORM_CHANNEL[stage]
        if over is None or name not in self.names:
            return []
        channel = self.channel(name)
        rows = series(stage, over, channel, self._units.get(stage, np.ones(1)), data, self.base, self.machine)
        return [self.column(f"{stage} over {variable} {k + 1}", {name: row}) for k, row in enumerate(rows)]

    def series_columns(self, parts: Parts) -> dict[str, list[tuple[Column, Array]]]:
        """By channel: every column of a refit that touches it, beside its series over the channel's grid."""
        found: dict[str, list[tuple[Column, Array]]] = {c.name: [] for c in self.channels}
        for column in [*self._fixed, *self.slopes(parts)]:
            for channel in self.channels:
                if channel.name in column.coefficients:
                    found[channel.name].append((column, series_of(column.coefficients[channel.name], channel.cut)))
        return found

    def candidate_column(self, parts: Parts, candidate: Candidate) -> Column:
        """What one unit of a candidate does on top of a hypothesis."""
        name = (parts, candidate.key)
        if name not in self._tried:
            if len(self._tried) > 200:
                self._tried.clear()
            change = self.difference(parts, candidate.part)
            size = candidate.part.size
            self._tried[name] = self.column(candidate.key, {k: v / size for k, v in change.items()})
        return self._tried[name]

    # -- hypotheses ------------------------------------------------------------------------------------------------

    def slopes(self, parts: Parts) -> list[Column]:
        """Slope of the prediction in each part's size, at the hypothesis."""
        found = []
        for k, part in enumerate(parts):
            row = ROWS[part.id]
            if not row.has_slope:
                continue
            step = row.probe or max(0.002, 0.02 * abs(part.size))
            if row.ladder:
                step = max(0.02 * abs(part.size), 0.02 * abs(row.ladder[-1]))
            step = row.slope_step or step
            touched = self._touched(part.id)
            high = bounds(part.id)[1]
            step = step if part.size + step <= high else -step
            moved = (*parts[:k], part._replace(size=part.size + step), *parts[k + 1:])
            now = self.predicted(parts)
            plan = schedule(self.base, moved)
            change = {c.name: (c.predict(plan, MOST_STEP_S) - now[c.name]) / step
                      for c in self.channels if c.name in touched}
            found.append(self.column(f"slope {k}", change))
        return found

    def form_columns(self, parts: Parts, slope: Sequence[Column], share: float = FORM_SHARE) -> list[Column]:
        """Freedom of form of each part: smooth shapes of its variable with a prior in proportion to its signal."""
        found: list[Column] = []
        for column in slope:
            part = parts[int(column.key.split()[1])]
            wobbles: list[Column] = []
            row = ROWS[part.id]
            if row.form_over:
                wobbles = self.forms(row.stage, row.form_over)
            for sibling in row.siblings:
                step = ROWS[sibling].ladder[1]
                one = self.difference(parts, Part(sibling, step))
                wobbles = [*wobbles, self.column(f"sibling {sibling}", {k: v / step for k, v in one.items()})]
            if not wobbles:
                continue
            stack = [*self._fixed, column, *wobbles]
            p = problem(self.channels, self._zero, stack)
            normal, _ = projected(p, np.arange(len(self._fixed)), self.noise)
            own = normal[len(self._fixed), len(self._fixed)]
            for k, wobble in enumerate(wobbles):
                at = len(self._fixed) + 1 + k
                ratio = max(own, 0.0) / max(normal[at, at], 1e-12) / len(wobbles)
                sd = share * abs(part.size) * np.sqrt(ratio)
                found.append(Column(f"{wobble.key} of {part.id}", wobble.coefficients, max(1e-9, float(sd))))
        return found

    @property
    def _zero(self) -> dict[str, Array]:
        return {c.name: np.zeros(len(c.cut.order)) for c in self.channels}

    def data_of(self, parts: Parts) -> dict[str, Array]:
        left = self.residual(parts)
        return {c.name: coefficients(left[c.name], c.cut) for c in self.channels}

    def base_columns(self, parts: Parts, share: float = FORM_SHARE) -> list[Column]:
        """Nuisances, slopes and forms of a hypothesis, in the order of `compressed`."""
        slope = self.slopes(parts)
        return [*self._fixed, *slope, *self.form_columns(parts, slope, share)]

    def trace(self, parts: Parts, k: int) -> Column:
        """What the whole of part k does, the others in place."""
        others = (*parts[:k], *parts[k + 1:])
        return self.column(f"trace {k}", self.difference(others, parts[k]))

    def compressed(self, parts: Parts, more: Sequence[Column] = ()) -> tuple[Problem, int]:
        """Problem at a hypothesis: nuisances, slopes, forms, then `more`; and how many come before `more`."""
        base = self.base_columns(parts)
        return problem(self.channels, self.data_of(parts), [*base, *more]), len(base)

    def scan(self, parts: Parts, noise: dict[str, Noise], only: Sequence[Candidate] | None = None) -> list[Found]:
        """Every candidate added to a refitted hypothesis, best first, one entry per effect, member and onset."""
        tried = [c for c in (self.candidates if only is None else only)
                 if not any(p.id == c.part.id and p.member == c.part.member for p in parts)]
        columns = [self.candidate_column(parts, c) for c in tried]
        p, before = self.compressed(parts, columns)
        fixed = np.arange(before)
        null = best_fitted(p, fixed, noise, self.channels)
        starts = [null.noise, calm(null.noise, self.channels)]
        normals = [projected(p, fixed, start) for start in starts]
        best: dict[tuple[str, int | None, float | None], Found] = {}
        for k, c in enumerate(tried):
            found = Found(c.part, -np.inf)
            for start, (normal, right) in zip(starts, normals, strict=True):
                tried_one = self._added(p, before + k, c, null, start, normal, right)
                found = max(found, tried_one, key=lambda f: f.gain)
            name = (c.part.id, c.part.member, c.part.onset_s)
            if name not in best or found.gain > best[name].gain:
                best[name] = found
        return sorted(best.values(), key=lambda f: -f.gain)

    def _added(self, p: Problem, at: int, c: Candidate, null: Fit, start: dict[str, Noise], normal: Array,
               right: Array) -> Found:
        """One candidate column beside the fixed ones, its noise fitted from `start` where the gain may matter."""
        stiff, before = normal[at, at], len(null.amplitude)
        if stiff <= 0.0:
            return Found(c.part, -np.inf)
        whole = ROWS[c.part.id].threshold             # half a threshold's column is not what half a threshold does
        size = c.part.size if whole else float(np.clip(right[at] / stiff, c.low, c.high))
        gain = 2.0 * right[at] * size - stiff * size * size
        if gain > FITTED_FROM and not whole:
            full = fitted(p, np.append(np.arange(before), at), start)
            size = float(np.clip(full.amplitude[-1], c.low, c.high))
            gain = 2.0 * (full.log_likelihood - null.log_likelihood) if size == full.amplitude[-1] else \
                min(gain, 2.0 * (full.log_likelihood - null.log_likelihood))
        elif start is not null.noise and not whole:
            return Found(c.part, -np.inf)
        return Found(c.part._replace(size=size), float(gain))

    def refit(self, parts: Parts, noise: dict[str, Noise] | None = None) -> Refit:
        """Sizes, their s.d. and likelihood of a hypothesis, its model rerun until the sizes stand still."""
        now, last, best = parts, noise or self.noise, None
        for _ in range(ROUNDS):
            fit, slopes_at, p = self._fit(now, last)
            if best is not None and fit.log_likelihood < best.log_likelihood - 0.5:
                now = tuple(a._replace(size=0.5 * (a.size + b.size)) for a, b in zip(best.parts, now, strict=True))
                fit, slopes_at, p = self._fit(now, last)
            sd = [0.0] * len(now)
            moved = list(now)
            biggest = 0.0
            for column, at in slopes_at:
                k = int(p.keys[column].split()[1])
                sd[k] = float(np.sqrt(fit.covariance[at, at]))
                low, high = bounds(now[k].id)
                size = float(np.clip(now[k].size + fit.amplitude[at], low, high))
                biggest = max(biggest, abs(size - now[k].size) / max(sd[k], 1e-9))
                moved[k] = now[k]._replace(size=size)
            last = fit.noise
            best = Refit(now, tuple(sd), fit.log_likelihood, fit.noise,
                         self._tangled(p, [at for at, _ in slopes_at], fit.noise))
            if biggest < 0.05 or not slopes_at:
                break
            now = tuple(moved)
        assert best is not None
        best = best._replace(parts=tuple(moved) if biggest < 0.05 else best.parts)
        return self._threshold(best) if any(ROWS[part.id].threshold for part in best.parts) else best

    def under(self, parts: Parts, noise: dict[str, Noise]) -> float:
        """Log-likelihood of a refitted hypothesis under a given noise, its forms held closer to the catalogue's."""
        base = self.base_columns(parts, RIVAL_FORM_SHARE)
        p = problem(self.channels, self.data_of(parts), base)
        return fitted(p, np.arange(len(base)), noise, rounds=0).log_likelihood

    def _fit(self, parts: Parts, noise: dict[str, Noise]) -> tuple[Fit, list[tuple[int, int]], Problem]:
        p, count = self.compressed(parts)
        chosen = np.arange(count)
        slopes_at = [(k, k) for k, key in enumerate(p.keys) if key.startswith("slope ")]
        return best_fitted(p, chosen, noise, self.channels), slopes_at, p

    def _tangled(self, p: Problem, places: list[int], noise: dict[str, Noise]) -> float:
        """Largest likeness of two parts' traces, nuisances taken out and their forms as the catalogue has them."""
        if len(places) < 2:
            return 0.0
        normal, _ = projected(p, np.arange(len(self._fixed)), noise)
        part = normal[np.ix_(places, places)]
        scale = np.sqrt(np.maximum(np.diag(part), 1e-300))
        return float((np.abs(part) / scale[:, None] / scale - np.eye(len(places))).max())

    def _threshold(self, found: Refit) -> Refit:
        """The threshold moved, in ever smaller steps, to where it fits best; its interval is what the log leaves open.

        A threshold acts on the commands that were given: between two of them every value is as good.
        """
        k = next(k for k, part in enumerate(found.parts) if ROWS[part.id].threshold)
        part = found.parts[k]
        edges = self._commands_between(*bounds(part.id))
        tried: dict[int, Refit] = {}

        def value(place: int) -> float:
            if place not in tried:
                parts = _sized(found.parts, k, 0.5 * float(edges[place] + edges[place + 1]))
                fit, _, _ = self._fit(parts, found.noise)
                tried[place] = found._replace(parts=parts, log_likelihood=fit.log_likelihood, noise=fit.noise)
            return tried[place].log_likelihood

        last = len(edges) - 2
        here, step = int(np.clip(np.searchsorted(edges, part.size) - 1, 0, last)), 2
        if part.id not in self._sought:                 # a plateau leads nowhere: look all over once
            self._sought.add(part.id)
            places = np.unique(np.linspace(0, last, THRESHOLDS_TRIED).astype(int)).tolist()
            here, step = max([here, *places], key=value), max(1, last // THRESHOLDS_TRIED)
        while step:
            near = [place for place in (here - step, here + step) if 0 <= place <= last]
            better = max([here, *near], key=value)
            step, here = (step, better) if better != here else (step // 2, here)
        as_good = [place for place in tried if value(place) > value(here) - 0.5 * THRESHOLD_GAP]
        low, high = float(edges[min(as_good)]), float(edges[max(as_good) + 1])
        best = tried[here]
        return best._replace(parts=_sized(best.parts, k, 0.5 * (low + high)),
                             sd=(*best.sd[:k], 0.5 * (high - low) / Z90, *best.sd[k + 1:]))

    def _commands_between(self, low: float, high: float) -> Array:
        """The shaft speeds that were asked for between two bounds, and the bounds."""
        command = np.empty(0) if self.data.shaft is None else np.round(self.data.shaft.command, 3)
        return np.unique(np.concatenate(([low], command[(command > low) & (command < high)], [high])))

    def tame(self, parts: Parts) -> None:
        """Lone readings far off the richest fit are drawn in; steady or repeated deviations are left as they are."""
        columns = [self.candidate_column(parts, c)._replace(sd=max(abs(c.low), abs(c.high))) for c in self.candidates
                   if not any(p.id == c.part.id and p.member == c.part.member for p in parts)]
        slope = self.slopes(parts)
        every = [*self._fixed, *slope, *self.form_columns(parts, slope), *columns]
        whole = {c.name: self.residual(parts)[c.name] + self._excess[c.name] for c in self.channels}
        data = {c.name: coefficients(whole[c.name], c.cut) for c in self.channels}
        p = problem(self.channels, data, every)
        amplitude, _ = solved(p, np.arange(len(every)), self.noise)
        for channel in self.channels:
            left = data[channel.name].copy()
            for size, column in zip(amplitude, every, strict=True):
                if channel.name in column.coefficients:
                    left -= size * column.coefficients[channel.name]
            rest = series_of(left, channel.cut)
            lone, free = _lone(rest), self._at_ease(channel)
            tails = np.zeros(len(rest))
            for begin, end in channel.cut.bounds if free.any() else ():
                tails[begin:end] = tail_excess((rest - lone)[begin:end], free[begin:end])
            self._excess[channel.name] = lone + tails

    def _at_ease(self, channel: Channel) -> npt.NDArray[np.bool_]:
        """Samples whose deviations are noise and nothing else: no drive answers a command there."""
        free = np.full(len(channel.measured), channel.name != "scale")
        drive = {"shaft": self.data.shaft, "gate": self.data.gate}.get(channel.name)
        if drive is not None:
            changes = np.concatenate(([-np.inf], drive.time_s[1:][np.diff(drive.command) != 0.0], [np.inf]))
            after = np.searchsorted(changes, channel.grid.even_s, side="right")
            free &= (channel.grid.even_s - changes[after - 1] > ANSWERED_S) & (
                changes[np.minimum(after, len(changes) - 1)] - channel.grid.even_s > channel.grid.step_s)
        return free


def _excited(candidate: Candidate, data: RunData) -> bool:
    """Whether the log moves what the effect needs to be moved.

    Missing pulses show as dips where the log is fine enough (`spells`); only a coarse log shows nothing but their mean.
    """
    row = ROWS[candidate.part.id]
    if row.found_by is FoundBy.DIPS and data.speed is not None:
        return float(np.median(np.diff(data.speed.time_s))) > DIPS_WITHIN_S
    if not row.seen_in_steps and data.shaft is not None and data.shaft.step > 0.0:
        return False
    opening = data.variables.get("opening_mm")
    if not row.min_move_mm or opening is None:
        return True
    return bool(np.ptp(np.percentile(opening, (1.0, 99.0))) >= row.min_move_mm)


def _sized(parts: Parts, k: int, size: float) -> Parts:
    return (*parts[:k], parts[k]._replace(size=size), *parts[k + 1:])


def _grown(part: Part, by: float) -> Part:
    low, high = bounds(part.id)
    return part._replace(size=min(high, max(low, part.size + float(by))))


def _lone(left: Array) -> Array:
    sd = 1.4826 * float(np.median(np.abs(left - np.median(left))))
    size = np.abs(left - np.median(left))
    beside = np.maximum(np.append(size[1:], 0.0), np.insert(size[:-1], 0, 0.0))
    lone = (size > OUTLIER * sd) & (beside < 0.7 * OUTLIER * sd)
    return np.where(lone, left - np.sign(left) * OUTLIER * sd, 0.0)
