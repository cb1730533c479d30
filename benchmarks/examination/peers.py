"""Entries around libraries that others keep, each on the residuals and traces of plain.py.

A peer gives each fault log odds; `python benchmarks/examination/learn.py` makes probabilities of
them by isotonic regression on the training cases, for every peer alike. Without that file the odds
are taken as they are.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from plain import Channel, Floats, Plain, count_rows, fit_channel, read_case
from scipy.special import expit

TRAINED = Path(__file__).resolve().parents[2] / ".benchmarks" / "examination" / "trained"
# Prior odds of a fault in a channel, shared by its faults.
FAULT_ODDS = 0.3 / 0.7
# Most rows that a library is given: series are averaged to fewer. SysIdentPy is the slow one.
MOST_ROWS, MOST_ROWS_NARMAX = 1500, 500


class Said(NamedTuple):
    """What a peer finds. odds : log odds of each fault. sizes : size and s.d. left : log of what
    is left of the residual over what neighbouring rows differ by, the largest of the channels."""

    odds: dict[str, float]
    sizes: dict[str, tuple[float, float]]
    left: float
    onset_s: dict[str, float]


def measure_rest(rest: Floats) -> float:
    """Returns how much more slowly a series varies than noise: log of the variance of the means of
    forty blocks over what the differences of their quarters let expect."""
    block = len(rest) // 160
    if block < 1:
        return 0.0
    quarters = rest[: 160 * block].reshape(160, block).mean(axis=1)
    noise = float(np.var(np.diff(quarters))) / 2.0
    spread = float(np.var(quarters.reshape(40, 4).mean(axis=1)))
    return float(np.log(4.0 * spread / max(noise, 1e-12) + 1e-3))


def _thin(channel: Channel, most: int = MOST_ROWS) -> tuple[Floats, Floats, list[str]]:
    """Returns a channel's residual (n,) and traces (n, k), each trace of unit r.m.s., averaged to
    at most `most` rows, and the traces' names."""
    names = [n for n, x in channel.columns.items() if float(x @ x) > 1e-9 * len(x)]
    block = -(-len(channel.left) // most)
    count = len(channel.left) // block

    def average(x: Floats) -> Floats:
        return np.asarray(x[: count * block].reshape(count, block).mean(axis=1))

    traces = np.array([average(channel.columns[n]) for n in names]).reshape(len(names), count).T
    scale = np.sqrt(np.mean(traces**2, axis=0)) if names else np.ones(0)
    return average(channel.left), traces / np.maximum(scale, 1e-12), names


def find_by_least_squares(case: Plain) -> Said:
    """Least squares for each fault of each channel, weighed by the criterion of Schwarz (1978)."""
    odds: dict[str, float] = {}
    sizes: dict[str, tuple[float, float]] = {}
    lefts = [0.0]
    for channel in case.channels:
        fits = fit_channel(channel, case.tolerances)
        if not fits:
            continue
        price = 0.5 * np.log(count_rows(channel.left)) - np.log(FAULT_ODDS / len(fits))
        worth = {n: one.gain - price for n, one in fits.items()}
        for name, own in worth.items():
            others = [0.0, *(v for n, v in worth.items() if n != name)]
            odds[name] = max(odds.get(name, -50.0), own - float(np.logaddexp.reduce(others)))
            sizes[name] = (fits[name].size, fits[name].sd)
        best = max(fits, key=lambda n: fits[n].gain)
        lefts.append(measure_rest(channel.left - fits[best].size * channel.columns[best]))
    return Said(odds, sizes, max(lefts), {})


def find_by_sysidentpy(case: Plain) -> Said:
    """SysIdentPy: forward regression with error reduction ratios (FROLS) of the residual on the
    traces and its own last value; the number of terms by the criterion."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS

    plain = find_by_least_squares(case)
    odds: dict[str, float] = {}
    lefts = [0.0]
    for channel in case.channels:
        y, traces, names = _thin(channel, MOST_ROWS_NARMAX)
        if not names or len(y) < 20 or y.std() < 1e-9:
            continue
        model = FROLS(
            order_selection=True,
            n_info_values=min(5, len(names) + 1),
            info_criteria="bic",
            ylag=1,
            xlag=[[1]] * len(names) if len(names) > 1 else [1],
            basis_function=Polynomial(degree=1),
        )
        # A trace acts in its own row: the library's inputs act a row later.
        model.fit(X=np.vstack([traces[1:], traces[-1:]]), y=y[:, None])
        rows = count_rows(y)
        for name in names:
            odds.setdefault(name, -8.0)
        for code, ratio in zip(np.asarray(model.final_model), model.err, strict=False):
            k = int(code[0]) // 1000 - 2
            if 0 <= k < len(names):
                gain = -0.5 * rows * float(np.log(max(1e-9, 1.0 - float(ratio))))
                own = _limit_gain(gain, names[k], plain, case)
                odds[names[k]] = max(
                    odds[names[k]], own - 0.5 * np.log(rows) - np.log(len(names) / FAULT_ODDS)
                )
        lefts.append(measure_rest(y))
    return Said(odds, plain.sizes, max(lefts), {})


def _fit_rows(traces: Floats, y: Floats) -> Floats:
    """Returns what traces (n, k) explain of a series (n,)."""
    return np.asarray(traces @ np.linalg.lstsq(traces, y, rcond=1e-6)[0])


def _limit_gain(gain: float, name: str, plain: Said, case: Plain) -> float:
    """Returns a gain no larger than a size allows that a machine within its tolerances has."""
    tolerance = case.tolerances.get(name, 0.0)
    size = plain.sizes.get(name, (0.0, 0.0))[0]
    return min(gain, 0.5 * (size / tolerance) ** 2) if tolerance > 0.0 else gain


def find_by_pysindy(case: Plain) -> Said:
    """PySINDy: sparse regression (STLSQ) of the residual on the traces."""
    from pysindy import STLSQ

    plain = find_by_least_squares(case)
    odds: dict[str, float] = {}
    lefts = [0.0]
    for channel in case.channels:
        y, traces, names = _thin(channel)
        if not names or len(y) < 8 or y.std() < 1e-9:
            continue
        scale = float(np.sqrt(np.mean(y**2)))
        # Traces that are alike share what they explain.
        sparse = STLSQ(threshold=0.1, alpha=0.02 * len(y))
        with warnings.catch_warnings():
            # Nothing kept is an answer.
            warnings.simplefilter("ignore")
            sparse.fit(traces, y[:, None] / scale)
        kept = np.flatnonzero(np.asarray(sparse.coef_).ravel())
        rest = y - _fit_rows(traces[:, kept], y)
        rows, after = count_rows(rest), max(float(rest @ rest), 1e-12)
        for k, name in enumerate(names):
            odds.setdefault(name, -8.0)
            if k in kept:
                without = y - _fit_rows(traces[:, kept[kept != k]], y)
                gain = 0.5 * rows * float(np.log(max(float(without @ without), after) / after))
                own = _limit_gain(gain, name, plain, case)
                odds[name] = max(
                    odds[name], own - 0.5 * np.log(rows) - np.log(len(names) / FAULT_ODDS)
                )
        lefts.append(measure_rest(rest))
    return Said(odds, plain.sizes, max(lefts), {})


def find_by_ruptures(case: Plain) -> Said:
    """ruptures: one change of the residual's mean (binary segmentation); least squares with each
    trace from there on, where that is better than the whole."""
    import ruptures

    whole = find_by_least_squares(case)
    odds, sizes, onset_s = dict(whole.odds), dict(whole.sizes), dict[str, float]()
    for channel in case.channels:
        y, _, names = _thin(channel)
        if len(y) < 40 or not names:
            continue
        at = ruptures.Binseg(model="l2").fit(y[:, None]).predict(n_bkps=1)[0]
        from_s = float(
            channel.time_s[min(len(channel.time_s) - 1, at * len(channel.left) // len(y))]
        )
        fits = fit_channel(channel, case.tolerances)
        later_fits = fit_channel(channel, case.tolerances, channel.time_s >= from_s)
        price = np.log(count_rows(channel.left)) - np.log(0.3 * FAULT_ODDS / len(names))
        best = max([price, *(one.gain for one in fits.values())])
        for name, one in later_fits.items():
            if one.gain > fits[name].gain + price and one.gain > best:
                odds[name] = max(odds[name], one.gain - best)
                sizes[name], onset_s[name] = (one.size, one.sd), from_s
    return Said(odds, sizes, whole.left, onset_s)


FINDERS: dict[str, Callable[[Plain], Said]] = {
    "least_squares": find_by_least_squares,
    "sysidentpy": find_by_sysidentpy,
    "pysindy": find_by_pysindy,
    "ruptures": find_by_ruptures,
}


def list_odds(said: Said) -> dict[str, float]:
    """Returns what isotonic regression maps: log odds of each fault, `none`, `unknown`."""
    best = max(said.odds.values(), default=-8.0)
    return {**said.odds, "none": -max(best, said.left - 1.0), "unknown": said.left - 1.0}


def diagnose(name: str, data: Path, machine: Path) -> dict[str, Any]:
    """Returns the answer of a peer."""
    said = FINDERS[name](read_case(data, machine))
    maps: dict[str, Any] = {}
    if (TRAINED / f"{name}.json").exists():
        maps = json.loads((TRAINED / f"{name}.json").read_text(encoding="utf-8"))

    def turn_into_p(label: str, odds: float) -> float:
        known = maps.get(label if label in ("none", "unknown") else "cause")
        return float(expit(odds) if known is None else np.interp(odds, *known))

    p = {label: turn_into_p(label, odds) for label, odds in list_odds(said).items()}
    return {
        # A fault without a trace here is as rare as on any machine.
        "causes": {**maps.get("share", {}), **{n: x for n, x in p.items() if "." in n}},
        "none": p["none"],
        "unknown": p["unknown"],
        "size": {
            n: [size - 1.645 * sd, size, size + 1.645 * sd]
            for n, (size, sd) in said.sizes.items()
            if np.isfinite(sd)
        },
        "onset_s": said.onset_s,
        "machine": None,
    }


def diagnose_least_squares(data: Path, machine: Path) -> dict[str, Any]:
    """Least squares with the criterion of Schwarz."""
    return diagnose("least_squares", data, machine)


def diagnose_sysidentpy(data: Path, machine: Path) -> dict[str, Any]:
    """SysIdentPy's FROLS."""
    return diagnose("sysidentpy", data, machine)


def diagnose_pysindy(data: Path, machine: Path) -> dict[str, Any]:
    """PySINDy's STLSQ."""
    return diagnose("pysindy", data, machine)


def diagnose_ruptures(data: Path, machine: Path) -> dict[str, Any]:
    """ruptures before least squares."""
    return diagnose("ruptures", data, machine)
