"""The forms that a search for terms tries over one variable or two: a few series each, linear in what is fitted."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.machine.compiled import term_run
from control.machine.term_step import SIDE, TermParams
from control.machine.terms import ANGLES, NODES, SHAFT_ANGLE, Form, Variable

Array = npt.NDArray[np.float64]

QUANTILES = (6, 18, 30, 42, 50, 58, 70, 82, 94)     # where a form may bend
MEMORIES_S = (1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0)
WAYS_S = (1.5, 5.0)                 # which way something has been moving, over so long
WAY_SHARE = 0.1                     # of its spread: a difference of so much tells the way
ONE_AXIS = 0.03                     # of the variance along an axis: less across it is none
ALONG_DEG = (15.0, 30.0)            # from an axis: what was seen on it holds so far, and from there on no more
CYCLES = {"heading_deg": (1, 2, 3), SHAFT_ANGLE: (1, 2, 3, 4, 5, 6)}
SPAN_EDGES = 24
SPAN_PLACES = 100                   # of either edge: it is known to some per cent of the log
SHAPES = 4                          # smooth half-waves that a table is made of
# Price of a form in twice the log-likelihood: for each amplitude, and twice the logarithm of the places tried.
PER_AMPLITUDE = 4.0


class Tried(NamedTuple):
    """A form with what is not linear in it settled. `shape_params` : those settings, for `columns_at`."""

    form: Form
    over: tuple[str, ...]
    shape_params: dict[str, float]
    mix: Array                  # (basis, amplitudes): the form's columns from those of the basis
    places: int                 # so many such forms are tried, at different places or of different memory

    @property
    def price(self) -> float:
        """What ranks forms in a scan, in twice the log-likelihood."""
        return float(PER_AMPLITUDE * self.mix.shape[1] + 2.0 * np.log(max(1, self.places)))


class Basis(NamedTuple):
    """Series over the rows, (k, rows), and the forms that are made of them."""

    series: Array
    forms: tuple[Tried, ...]


class Scaled(NamedTuple):
    """A variable for fitting: (x - middle) / spread."""

    name: str
    x: Array                    # (rows,), held within low and high
    middle: float
    spread: float
    low: float
    high: float

    @property
    def z(self) -> Array:
        return np.asarray((self.x - self.middle) / self.spread)

    @property
    def variable(self) -> Variable:
        return Variable(name=self.name, valid=None if self.name in (*ANGLES, "time_s") else (self.low, self.high))


def scaled(name: str, x: Array, work: npt.NDArray[np.bool_]) -> Scaled:
    """work : rows that count for the range (rows,)."""
    low, q10, middle, q90, high = (float(v) for v in np.percentile(x[work], (0.5, 10, 50, 90, 99.5)))
    spread = max(0.5 * (q90 - q10), 1e-3 * (high - low), 1e-9)
    held = x if name in (*ANGLES, "time_s") else np.clip(x, low, high)
    return Scaled(name, held, middle, spread, low, high if high > low else low + 1.0)


def knots(v: Scaled, work: npt.NDArray[np.bool_]) -> Array:
    """Places, in units of z, where a form may bend: quantiles, and 0 where the variable changes its sign."""
    found = np.percentile(v.z[work], QUANTILES)
    zero = (0.0 - v.middle) / v.spread
    if found[0] < zero < found[-1]:
        found = np.append(found, zero)
    return np.unique(np.round(found, 6))


def remembered(v: Scaled, tau_s: float, time_s: Array) -> Array:
    """First-order memory of z with `tau_s`, as the evaluator has it: (rows,)."""
    params = TermParams(int(list(Form).index(Form.MEMORY)), bend=1.0, tau_s=tau_s)
    z = np.ascontiguousarray(v.z)
    return np.asarray(term_run(params, z, z, time_s))


def moving(v: Scaled, tau_s: float, time_s: Array) -> Array:
    """-1 to 1: the way in which z has been moving of late."""
    params = TermParams(SIDE, above=1.0, below=-1.0, high_end=WAY_SHARE, tau_s=tau_s)
    z = np.ascontiguousarray(v.z)
    return np.asarray(term_run(params, z, z, time_s))


class _Mixer:
    """Forms as mixes of the series of a basis of one variable."""

    def __init__(self, name: str, size: int) -> None:
        self._name, self._size = name, size
        self.forms: list[Tried] = []

    def add(self, form: Form, shape_params: dict[str, float], columns: list[dict[int, float]], places: int = 1) -> None:
        """columns : weight of each series, for each amplitude. places : so many such forms are tried."""
        mix = np.zeros((self._size, len(columns)))
        for j, one in enumerate(columns):
            for row, weight in one.items():
                mix[row, j] += weight
        self.forms.append(Tried(form, (self._name,), shape_params, mix, places))


def over_one(v: Scaled, time_s: Array, work: npt.NDArray[np.bool_]) -> Basis:
    """All forms over one variable."""
    if v.name in ANGLES:
        return _periodic(v, work)
    if v.name == "time_s":
        return _spans(v)
    at, z = knots(v, work), v.z
    low, high = (float(end) for end in np.percentile(z[work], (0.5, 99.5)))
    share = np.clip((z - low) / max(high - low, 1e-9), 0.0, 1.0)
    blocks = [z[None], z[None] ** 2, np.maximum(0.0, z - at[:, None]), (z > at[:, None]).astype(np.float64),
              np.array([remembered(v, tau, time_s) for tau in MEMORIES_S]),
              np.array([moving(v, tau, time_s) for tau in WAYS_S]),
              np.array([np.cos(np.pi * n * share) for n in range(1, SHAPES + 1)])]
    hinge0, step0, memory0, way0, wave0, size = np.cumsum([len(one) for one in blocks])[1:].tolist()
    mixer = _Mixer(v.name, size)
    mixer.add(Form.SLOPE, {}, [{0: 1.0}])
    mixer.add(Form.BEND, {}, [{0: 1.0}, {1: 1.0}])
    for i, place in enumerate(at.tolist()):
        mixer.add(Form.HINGE, {"at": place}, [{0: 1.0}, {hinge0 + i: 1.0}], len(at))
        mixer.add(Form.THRESHOLD, {"at": place}, [{step0 + i: 1.0}], len(at))
    _ended(mixer, at, low, high, hinge0)
    for i, tau in enumerate(MEMORIES_S):
        mixer.add(Form.MEMORY, {"tau_s": tau}, [{memory0 + i: 1.0}], len(MEMORIES_S))
        mixer.add(Form.MEMORY, {"tau_s": tau, "both": 1.0}, [{0: 1.0}, {memory0 + i: 1.0}], len(MEMORIES_S))
    for i, tau in enumerate(WAYS_S):
        mixer.add(Form.SIDE, {"tau_s": tau}, [{way0 + i: 1.0}], len(WAYS_S))
    mixer.add(Form.TABLE, {"low": low, "high": high}, [{wave0 + n: 1.0} for n in range(SHAPES)], 4)
    return Basis(np.concatenate(blocks), tuple(mixer.forms))


def _ended(mixer: _Mixer, at: Array, low: float, high: float, hinge0: int) -> None:
    """Saturations between every two places or from an end on, and dead zones between every two places."""
    count = len(at)
    for i in range(-1, count):
        for j in range(i + 1, count + 1):
            ends = {"low_end": float(at[i]) if i >= 0 else low, "high_end": float(at[j]) if j < count else high}
            if (i < 0 and j == count) or not ends["low_end"] < ends["high_end"]:
                continue
            upper = {} if j == count else {hinge0 + j: -1.0}
            lower = {0: 1.0} if i < 0 else {hinge0 + i: 1.0}
            mixer.add(Form.SATURATION, ends, [{**lower, **upper}], count * count // 2)
            if i >= 0 and j < count:
                mixer.add(Form.DEAD_ZONE, ends, [{0: 1.0, hinge0 + i: -1.0, hinge0 + j: 1.0}], count * count // 2)


def _periodic(v: Scaled, work: npt.NDArray[np.bool_]) -> Basis:
    """Cycles of an angle. Where all angles lie on one axis (up and down a field) sine and cosine are not told apart:
    one cycle along that axis is tried, which says nothing of what was not driven."""
    angle = v.x * np.pi / 180.0
    cycles = CYCLES[v.name]
    series = np.array([wave(n * angle) for n in cycles for wave in (np.sin, np.cos)])
    strengths, axes = np.linalg.eigh(np.cov(series[:2, work]))
    if strengths[0] < ONE_AXIS * strengths[1]:
        mix = np.zeros((len(series), 1))
        mix[:2, 0] = axes[:, 1]
        return Basis(series, (Tried(Form.PERIODIC, (v.name,), {"cycles": float(cycles[0])}, mix, 1),))
    forms = []
    for k, n in enumerate(cycles):
        found = np.zeros((len(series), 2))
        found[2 * k, 0] = found[2 * k + 1, 1] = 1.0
        forms.append(Tried(Form.PERIODIC, (v.name,), {"cycles": float(n)}, found, len(cycles)))
    return Basis(series, tuple(forms))


def _spans(v: Scaled) -> Basis:
    edges = np.linspace(float(v.x[0]), float(v.x[-1]), SPAN_EDGES + 1)
    series = (v.x >= edges[1:-1, None]).astype(np.float64)
    forms = []
    for i in range(len(series)):
        for j in range(i + 1, len(series)):
            found = np.zeros((len(series), 1))
            found[i, 0], found[j, 0] = 1.0, -1.0
            forms.append(Tried(Form.SPAN, (v.name,), {"low_end": edges[i + 1], "high_end": edges[j + 1]}, found,
                               SPAN_PLACES ** 2))
    return Basis(series, tuple(forms))


def over_two(variables: Sequence[Scaled]) -> Basis:
    """Products of every two variables, alone and with what each does by itself."""
    return _products(variables, [(i, j) for i in range(len(variables)) for j in range(i + 1, len(variables))], True)


def with_one(variables: Sequence[Scaled], one: Scaled) -> Basis:
    """Products of every variable with one that nothing is laid to by itself, alone and with what the other does."""
    return _products([*variables, one], [(i, len(variables)) for i in range(len(variables))], False)


def _products(variables: Sequence[Scaled], pairs: Sequence[tuple[int, int]], second_main: bool) -> Basis:
    zs = [v.z for v in variables]
    series = np.array([*zs, *(zs[i] * zs[j] for i, j in pairs)])
    forms = []
    for k, (i, j) in enumerate(pairs):
        over, product = (variables[i].name, variables[j].name), len(zs) + k
        with_mains = [i, j, product] if second_main else [i, product]
        for shape_params, columns in (({}, [product]), ({"mains": 1.0}, with_mains)):
            mix = np.zeros((len(series), len(columns)))
            mix[columns, range(len(columns))] = 1.0
            forms.append(Tried(Form.PRODUCT, over, shape_params, mix, 1))
    return Basis(series, tuple(forms))


def columns_at(one: Tried, by: dict[str, Scaled], time_s: Array, **shape_params: float) -> Array:
    """A form's columns (amplitudes, rows) with other shape parameters."""
    v, shape = by[one.over[0]], {**one.shape_params, **shape_params}
    z = v.z
    if one.form is Form.HINGE:
        return np.array([z, np.maximum(0.0, z - shape["at"])])
    if one.form is Form.THRESHOLD:
        return (z > shape["at"]).astype(np.float64)[None]
    if one.form in (Form.SATURATION, Form.DEAD_ZONE):
        held = np.clip(z, shape["low_end"], shape["high_end"])
        return np.asarray((held - _held_at_0(shape) if one.form is Form.SATURATION else z - held)[None])
    if one.form is Form.MEMORY:
        slow = remembered(v, shape["tau_s"], time_s)
        return np.array([z, slow]) if "both" in shape else slow[None]
    if one.form is Form.SIDE:
        return moving(v, shape["tau_s"], time_s)[None]
    if one.form is Form.SPAN:
        return ((v.x >= shape["low_end"]) & (v.x < shape["high_end"])).astype(np.float64)[None]
    raise ValueError(f"form {one.form.value} has no shape")


def _held_at_0(shape: dict[str, float]) -> float:
    """z = 0 held between the ends of a saturation: there it is fitted as nothing."""
    return float(np.clip(0.0, shape["low_end"], shape["high_end"]))


def moved(one: Tried, name: str, steps: float, by: dict[str, Scaled]) -> float:
    """A shape that many steps away: a step is a factor of 2 of a time constant, 0.3 of a spread of a place."""
    value = one.shape_params[name]
    if name == "tau_s":
        return float(value * 2.0 ** steps)
    width = 0.3 if one.form is not Form.SPAN else float(np.ptp(by["time_s"].x)) / SPAN_EDGES / 2.0
    return float(value + width * steps)


def movable(one: Tried) -> list[str]:
    """Shape parameters that may be moved."""
    if one.form in (Form.TABLE, Form.SIDE):
        return []
    return [name for name in one.shape_params if name in ("tau_s", "at", "low_end", "high_end")]


def coefficients(one: Tried, amplitude: Array, level: float, by: dict[str, Scaled]) -> dict[str, float]:
    """A form's coefficients in its variable's own unit; those of a table are `table_of`."""
    v, a, shape = by[one.over[0]], [float(size) for size in amplitude], one.shape_params
    if one.form is Form.PRODUCT:
        return _product(a, level, v, by[one.over[1]])
    if reported_form(one) is Form.TABLE:
        return {}
    at, s = v.middle, v.spread
    place = {name: value if one.form is Form.SPAN else float(at + s * value) for name, value in shape.items()
             if name in ("at", "low_end", "high_end")}
    found: dict[Form, dict[str, float]] = {
        Form.SLOPE: {"slope": a[0] / s, "at": at},
        Form.BEND: {"slope": a[0] / s, "bend": a[-1] / s ** 2, "at": at},
        Form.HINGE: {"below": a[0] / s, "above": (a[0] + a[-1]) / s, **place},
        Form.THRESHOLD: {"above": a[0], **place},
        Form.SATURATION: {"slope": a[0] / s, **place},
        Form.DEAD_ZONE: {"slope": a[0] / s, **place},
        Form.MEMORY: {"slope": a[0] / s if len(a) > 1 else 0.0, "bend": a[-1] / s, "at": at,
                      "tau_s": shape.get("tau_s", 0.0)},
        Form.SIDE: {"above": a[0], "below": -a[0], "high_end": WAY_SHARE * s, "tau_s": shape.get("tau_s", 0.0)},
        Form.PERIODIC: {"cycles": shape.get("cycles", 0.0), **_waves(one, amplitude)},
        Form.SPAN: {**place, "above": a[0]}}
    zero = 0.0                                  # the z at which a form with its coefficients is 0
    if one.form is Form.HINGE:
        zero = shape["at"]
    elif one.form is Form.SATURATION:
        zero = shape["low_end"] - _held_at_0(shape)
    return {**found[one.form], "level": level + a[0] * zero}


def _waves(one: Tried, amplitude: Array) -> dict[str, float]:
    """Sine and cosine of a cycle."""
    if one.form is not Form.PERIODIC:
        return {}
    k = CYCLES[one.over[0]].index(int(one.shape_params["cycles"]))
    sine, cosine = one.mix[2 * k:2 * k + 2] @ amplitude
    return {"sine": float(sine), "cosine": float(cosine)}


def reported_form(one: Tried) -> Form:
    """The form that a machine file is given: of a cycle that was driven along one axis alone a table, which says
    nothing of the other headings."""
    return Form.TABLE if one.form is Form.PERIODIC and one.mix.shape[1] == 1 else one.form


def table_of(one: Tried, amplitude: Array, level: float, by: dict[str, Scaled]) -> tuple[list[float], list[float]]:
    """Nodes and values of a table; both empty of every other form."""
    if reported_form(one) is not Form.TABLE:
        return [], []
    if one.form is Form.PERIODIC:
        return _along_axis(one, float(amplitude[0]), level)
    v, share = by[one.over[0]], np.linspace(0.0, 1.0, NODES)
    waves = np.array([np.cos(np.pi * n * share) for n in range(1, SHAPES + 1)])
    nodes = v.middle + v.spread * np.linspace(one.shape_params["low"], one.shape_params["high"], NODES)
    return nodes.tolist(), (level + amplitude @ waves).tolist()


def _along_axis(one: Tried, amplitude: float, level: float) -> tuple[list[float], list[float]]:
    """Nodes and values over the headings 0 to 360: what was seen along the axis one way and the other, and the level
    where the machine was not driven."""
    sine, cosine = one.mix[:2, 0]
    inner, outer = ALONG_DEG
    axis = float(np.degrees(np.arctan2(sine, cosine)))
    half_turns = int((axis + outer) // 180.0)
    axis -= 180.0 * half_turns                  # from -outer to 180 - outer: the way through north first, if one is
    size = (-1.0) ** half_turns * amplitude * float(np.hypot(sine, cosine))
    edges = [axis - outer, axis - inner, axis + inner, axis + outer]
    back = [edge + 180.0 for edge in edges]
    one_way, other_way = level + size, level - size
    if edges[0] >= 0.0:
        return [*edges, *back], [level, one_way, one_way, level, level, other_way, other_way, level]
    round_again = [edge + 360.0 for edge in edges[:2]]
    return [*edges[2:], *back, *round_again], [one_way, level, level, other_way, other_way, level, level, one_way]


def _product(a: Sequence[float], level: float, x: Scaled, y: Scaled) -> dict[str, float]:
    """k (x - at)(y - second_at) + level from what x, y (of three amplitudes) and their product do.

    level : 0 where the log does not hold it; the product is then nothing where one of its variables is at its place.
    """
    first, second, both = a[0] if len(a) > 1 else 0.0, a[1] if len(a) > 2 else 0.0, a[-1]
    return {"slope": both / (x.spread * y.spread), "at": x.middle - x.spread * second / both,
            "second_at": y.middle - y.spread * first / both, "level": level - first * second / both if level else 0.0}
