"""How visible an effect is: z, and whether another effect leaves the very same trace.

z is the length of the difference that the effect makes in all channels, whitened by the true
noise, after the machine's tolerances and the unknown scale levels have taken of it what they
can under their priors; an effect on what a tolerance moves too (a dead time) counts only as far
as no tolerated value does the same.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from . import nominal as nom
from .logged import Logged
from .noise import Noise, fresh_samples
from .nominal import Effect, Physics
from .plant import Plant

READINGS = ("shaft", "gate", "scale", "wheel", "gnss", "heads")
Floats = npt.NDArray[np.float64]


class Eye:
    """Sees differences between simulated readings in units of noise, nuisances taken out."""

    def __init__(
        self, plant: Plant, noises: dict[str, Noise], around: Physics, log: Logged | None = None
    ) -> None:
        self.plant, self.noises = plant, noises
        self.around = around
        self.log = log or Logged()
        self.base = plant.run(around)
        self.doubt = self.log.doubt(plant, around, self.base)
        self._told: list[tuple[Floats, Floats]] = []
        self._columns = self._nuisances()
        gram = self._columns @ self._columns.T + np.eye(len(self._columns))
        self._solve = np.linalg.inv(gram)

    def _nuisances(self) -> Floats:
        """One whitened row per nuisance and prior s.d."""
        p = self.around
        changed = [
            p._replace(**{name: getattr(p, name) + sd}) for name, sd in nom.TOLERANCE.items()
        ]
        heads = [
            p._replace(
                heads_ratio=tuple(
                    r + nom.HEAD_TOLERANCE * (i == m) for i, r in enumerate(p.heads_ratio)
                )
            )
            for m in range(nom.HEADS)
        ]
        refill = (
            [p._replace(level_kg=(p.level_kg[0], p.level_kg[1] + nom.LEVEL_TOLERANCE_KG[1]))]
            if self.plant.drive.refill_kg
            else []
        )
        rows = [self.whitened(self.plant.run(q)) for q in (*changed, *heads, *refill)]
        level = {k: np.zeros_like(v) for k, v in self.base.items()}
        level["scale"] = np.full_like(level["scale"], nom.LEVEL_TOLERANCE_KG[0])
        rows.append(self.whitened(level, is_difference=True))
        return np.array(rows)

    def whitened(self, readings: dict[str, Floats], is_difference: bool = False) -> Floats:
        """All channels of a difference to the base, whitened, one after another (samples of all
        channels,)."""
        d = readings if is_difference else {k: readings[k] - self.base[k] for k in READINGS}
        t = self.plant.drive.time_s
        parts = []
        for name in ("shaft", "gate", "scale"):
            n = self.noises[name]
            at = self.log.seen(fresh_samples(t.size, n), n.fresh_rows, name)
            sure = 1.0 if name not in self.doubt else n.sd / np.hypot(n.sd, self.doubt[name][at])
            parts.append(self._white(d[name][None, at] * sure, t[at], n))
        gnss, wheel = self.noises["gnss"], self.noises["wheel"]
        at = self.log.seen(fresh_samples(t.size, gnss), gnss.fresh_rows, "speed")
        # The ground speed itself is unknown: wheel minus GNSS.
        both = gnss._replace(
            sd=float(np.hypot(gnss.sd, wheel.sd)),
            step=float(np.hypot(gnss.step, wheel.step)),
            slow_sd=float(np.hypot(gnss.slow_sd, wheel.slow_sd)),
        )
        parts.append(self._white((d["wheel"] - d["gnss"])[None, at], t[at], both))
        n = self.noises["heads"]
        at = self.log.seen(fresh_samples(t.size, n), n.fresh_rows, "heads")
        heads = d["heads"][:, at]
        # the canopy itself is unknown
        parts.append(self._white(heads - heads.mean(axis=0), t[at], n))
        return np.concatenate(parts)

    def _white(self, signals: Floats, time_s: Floats, n: Noise) -> Floats:
        if not signals.any():
            return np.zeros(signals.size)
        return n.whitened(signals, time_s).ravel()

    def trace(self, effects: Iterable[Effect], beside: Iterable[Effect] = ()) -> Floats:
        """Whitened difference that `effects` make (in a machine that has `beside` already),
        before projection."""
        beside = tuple(beside)
        if not beside:
            return self.whitened(self.plant.run(self.around, effects))
        with_both = self.plant.run(self.around, (*beside, *effects))
        without = self.plant.run(self.around, beside)
        d = {k: with_both[k] - without[k] for k in READINGS}
        return self.whitened(d, is_difference=True)

    def inner(self, a: Floats, b: Floats) -> float:
        """Inner product of two traces after the nuisances took their part under their priors."""
        ja, jb = self._on_nuisances(a), self._on_nuisances(b)
        return float(a @ b - ja @ self._solve @ jb)

    def _on_nuisances(self, a: Floats) -> Floats:
        """Remembers the last few: one trace is held against many."""
        told = next((told for known, told in self._told if known is a), None)
        if told is None:
            told = np.asarray(self._columns @ a)
        self._told = [(a, told), *((k, v) for k, v in self._told if k is not a)][:2]
        return told

    def z(self, effects: Iterable[Effect], beside: Iterable[Effect] = ()) -> float:
        """Detectability of `effects` together."""
        effects, beside = tuple(effects), tuple(beside)
        d = self.trace(effects, beside)
        found = self.inner(d, d)
        for e in effects if len(effects) == 1 else ():
            found = min(found, self._beyond_twin(e, d, beside))
        return float(np.sqrt(max(0.0, found)))

    def _beyond_twin(self, e: Effect, d: Floats, beside: tuple[Effect, ...]) -> float:
        """Squared z of an effect that moves what a tolerance moves too, the tolerance moved as
        far as pays.

        A delay or a slew shorter than a row has kinks: the slope of the tolerance at nominal is
        no straight line to it.
        """
        if e.id not in nom.TWINS:
            return np.inf
        name, per_size = nom.TWINS[e.id]
        found = np.inf
        for share in (0.25, 0.5, 0.75, 1.0):
            moved = share * per_size * e.size
            other = self.around._replace(**{name: getattr(self.around, name) + moved})
            with_it, without = self.plant.run(other, beside), self.plant.run(self.around, beside)
            rest = d - self.whitened(
                {k: with_it[k] - without[k] for k in READINGS}, is_difference=True
            )
            found = min(found, self.inner(rest, rest) + (moved / nom.TOLERANCE[name]) ** 2)
        return found

    def likeness(self, a: Floats, b: Floats) -> float:
        """Cosine of two traces after the nuisances, -1 to 1; 0 where either leaves nothing."""
        aa, bb = self.inner(a, a), self.inner(b, b)
        return self.inner(a, b) / np.sqrt(aa * bb) if aa > 1e-9 and bb > 1e-9 else 0.0
