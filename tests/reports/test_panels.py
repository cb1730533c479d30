"""What is drawn is what it says: the series behind each legend entry."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from topdress.console.reports.binned_means import (
    ResidualAxis,
    calc_binned_means,
    calc_binned_rates,
    calc_shown_share,
    find_telling_axis,
)
from topdress.console.reports.chart import ChartPanel, ChartSheet
from topdress.console.reports.diagnosis_wording import describe_unexplained
from topdress.console.reports.number_text import (
    MINUS_SIGN,
    format_duration,
    format_number,
    format_p_value,
    format_percent,
    format_with_interval,
)
from topdress.console.reports.panels import (
    EXTENDED_LABEL,
    NOMINAL_LABEL,
    draw_residual_panel,
    draw_smooth_line,
)
from topdress.console.reports.run_pictures import MIN_EFFECT_SHARE_IN_MEANS, _find_telling_rows
from topdress.console.reports.run_views import list_effect_instances, make_run_views
from topdress.console.reports.table_pictures import draw_table_column
from topdress.console.reports.table_views import make_table_views
from topdress.control.calibration.bench_table import BenchTable
from topdress.control.diagnosis import diagnose_tables
from topdress.control.diagnosis.result import Cause, UnexplainedStructure
from topdress.control.machine.machine import Machine

X = np.linspace(0.0, 4.0, 400)
AXIS = ResidualAxis("x", X)


def test_nominal_is_before_and_extended_is_after() -> None:
    panel = ChartPanel()
    draw_residual_panel(
        panel, AXIS, calc_binned_means(AXIS, X - 5.0), calc_binned_means(AXIS, 0.0 * X + 0.1), "kg"
    )
    before, after = panel.series[NOMINAL_LABEL][1], panel.series[EXTENDED_LABEL][1]
    assert (before.min(), before.max()) == pytest.approx((-5.0, -1.0), abs=0.2)
    assert after == pytest.approx(0.1)


def test_nothing_named_draws_nothing_extended() -> None:
    panel = ChartPanel()
    draw_residual_panel(panel, AXIS, calc_binned_means(AXIS, X), None, "kg")
    assert EXTENDED_LABEL not in panel.series


def test_smooth_line_follows_what_is_there() -> None:
    panel = ChartPanel()
    draw_smooth_line(panel, X, 2.0 * np.cos(np.pi * X / 4.0))
    found = panel.series["smooth function"][1]
    assert found == pytest.approx(
        2.0 * np.cos(np.pi * np.linspace(0.04, 3.96, len(found)) / 4.0), abs=0.05
    )


def test_stretch_is_where_the_effect_changes() -> None:
    effect = np.where((np.arange(1000) >= 600) & (np.arange(1000) < 620), 1.0, 0.2)
    assert 500 < _find_telling_rows(effect, 100) <= 600
    assert _find_telling_rows(np.where(np.arange(1000) < 500, 1.0, 2.0) + 0.0, 2000) == 0


def test_table_picture_shows_both_machines(
    bench_tables: dict[str, BenchTable], machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    (view,) = make_table_views([bench_tables["place"]], machine, [cause_of("place.lever_arm", 0.4)])
    picture = draw_table_column(view)
    for words in (
        "before",
        "after",
        NOMINAL_LABEL,
        EXTENDED_LABEL,
        "measured",
        "miss_m, m",
        "residual, m",
    ):
        assert words in picture.svg
    (bare,) = make_table_views([bench_tables["place"]], machine, [])
    assert EXTENDED_LABEL not in draw_table_column(bare).svg


def test_colours_are_the_pages_own() -> None:
    sheet = ChartSheet(4.0, 3.0)
    draw_residual_panel(
        sheet.panel, AXIS, calc_binned_means(AXIS, X - 5.0), calc_binned_means(AXIS, 0.0 * X), "kg"
    )
    text = sheet.to_svg("title")
    assert all(f"var(--{name})" in text for name in ("before", "after", "ink", "grid"))
    assert not re.search(r"(?:fill|stroke): #", text)


# --- Means over a variable, and the variable that tells an effect
# ----------------------------------------------------


@pytest.fixture
def x() -> np.ndarray:
    return np.random.default_rng(3).uniform(0.0, 10.0, 20_000)


def test_means_follow_the_function_within_their_bands(x: np.ndarray) -> None:
    noise = np.random.default_rng(4).standard_normal(len(x))
    means = calc_binned_means(ResidualAxis("x", x), np.sin(x) + noise)
    off = np.abs(means.mean - np.sin(means.at))
    assert np.mean(off < means.half + 0.02) > 0.85
    assert np.all(means.half < 0.1)


def test_bands_widen_with_memory(x: np.ndarray) -> None:
    plain, slow = (
        calc_binned_means(ResidualAxis("x", x), np.cos(7.0 * x), memory) for memory in (0.0, 0.6)
    )
    assert slow.half == pytest.approx(2.0 * plain.half)


def test_the_axis_that_holds_the_effect_is_taken(x: np.ndarray) -> None:
    other = np.random.default_rng(5).uniform(0.0, 1.0, len(x))
    axes = (ResidualAxis("other", other), ResidualAxis("x", x))
    assert find_telling_axis(axes, x**2 - 30.0).label == "x"
    assert calc_shown_share(axes[0], x**2 - 30.0) < 0.2


def test_the_first_of_equals_is_taken(x: np.ndarray) -> None:
    assert (
        find_telling_axis(
            (ResidualAxis("first", x), ResidualAxis("copy", 2.0 * x)), np.sqrt(x)
        ).label
        == "first"
    )


def test_turned_residuals_do_not_cancel(x: np.ndarray) -> None:
    sign = np.where(np.arange(len(x)) % 2 == 0, 1.0, -1.0)
    means = calc_binned_means(ResidualAxis("x", x, sign), 3.0 * sign)
    assert means.mean == pytest.approx(3.0)
    assert calc_binned_means(ResidualAxis("x", x), 3.0 * sign).mean == pytest.approx(0.0, abs=0.3)


def test_named_values_keep_their_places() -> None:
    means = calc_binned_means(
        ResidualAxis("way", np.array([0.0, 1.0] * 10), names=("closing", "opening")),
        np.array([1.0, -1.0] * 10),
    )
    assert means.at.tolist() == [0.0, 1.0]
    assert means.mean.tolist() == [1.0, -1.0]


@pytest.mark.parametrize("memory", [0.0, 0.6])
def test_rates_are_read_off_the_level(memory: float) -> None:
    rng = np.random.default_rng(7)
    place = np.repeat(rng.integers(0, 3, 60), 40).astype(float)
    rates = np.array([-0.02, 0.0, 0.01])
    off = []
    for _ in range(40):
        noise = rng.standard_normal(len(place))
        for k in range(1, len(noise)):
            noise[k] = memory * noise[k - 1] + np.sqrt(1.0 - memory**2) * noise[k]
        level = np.concatenate(([0.0], np.cumsum(rates[place.astype(int)])[:-1])) + 0.15 * noise
        segments = np.repeat([0, 1], len(place) // 2)
        found = calc_binned_rates(
            ResidualAxis("place", place), level + 90.0 * segments, 1.0, segments, memory
        )
        off.append((found.mean - rates) / found.half)
    assert found.half.max() < 0.002
    assert 0.80 < np.mean(np.abs(off) < 1.0) < 0.97


# --- Numbers as people write them
# ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0"),
        (1234567.0, "1230000"),
        (-0.0123456, "−0.0123"),
        (8.1, "8.10"),
        (None, "–"),
        (float("nan"), "–"),
        (1e-9, "0"),
        (4e-7, "0"),
        (7e-7, "0.000001"),
        (99.96, "100.0"),
        (12345.6, "12300"),
    ],
)
def test_number(value: float | None, said: str) -> None:
    assert format_number(value) == said


@pytest.mark.parametrize(
    ("value", "low", "high", "said", "interval"),
    [
        (0.4692, 0.4061, 0.5329, "0.469", "0.406 to 0.533"),
        (-1.784, -1.95, -1.61, "−1.78", "−1.95 to −1.61"),
        (8.13, 2.2, 14.1, "8.1", "2.2 to 14.1"),
        (231.4, 105.0, 350.0, "231", "105 to 350"),
        (0.109404, 0.109366, 0.109442, "0.1094", "narrower than the last digit"),
        (3.0, None, None, "3.00", ""),
        (0.02, -0.3, 0.34, "0.02", "−0.30 to 0.34"),
        (-50.0, -99.98, -0.02, "−50", "−100 to 0"),
        (0.0005, 0.0, 0.001, "0.00050", "0.00000 to 0.00100"),
    ],
)
def test_interval_decides_the_digits(
    value: float, low: float | None, high: float | None, said: str, interval: str
) -> None:
    assert format_with_interval(value, low, high) == (said, interval)


def test_shares_never_claim_certainty() -> None:
    assert [format_percent(p) for p in (1.0, 0.9951, 0.9949, 0.26, 0.006, 0.0049, 0.0)] == [
        ">99 %",
        ">99 %",
        "99 %",
        "26 %",
        "1 %",
        "<1 %",
        "<1 %",
    ]
    assert [format_p_value(p) for p in (0.0, 0.00099, 0.0012, 0.0134)] == [
        "<0.001",
        "<0.001",
        "0.001",
        "0.013",
    ]


def test_spans_read_like_a_clock() -> None:
    assert [
        format_duration(s) for s in (59.6, 119.0, 120.0, 370.0, 1200.0, 7199.0, 7200.0, 7860.0)
    ] == [
        "60 s",
        "119 s",
        "2 min",
        "6 min 10 s",
        "20 min",
        "119 min 59 s",
        "2 h 00 min",
        "2 h 11 min",
    ]


@pytest.mark.parametrize(("share", "said"), [(0.0, "<1 %"), (0.624, "62 %"), (1.0, ">99 %")])
def test_the_share_that_no_effect_explains_is_in_per_cent(share: float, said: str) -> None:
    follows = (
        "flow changes with pitch{name}; none of the known causes fits: "
        "that is {said} of the error not yet explained."
    )
    for column, name in ((True, " (pitch_deg)"), (False, "")):
        assert describe_unexplained(
            UnexplainedStructure("flow", "pitch_deg", share), "run", column
        ) == follows.format(name=name, said=said)
    assert describe_unexplained(UnexplainedStructure("flow", "", share), "run").startswith(
        "flow is off by more than chance"
    )


@pytest.mark.parametrize(
    ("half", "said", "interval"),
    [
        (350.0, "1234", "884 to 1584"),
        (12.0, "1234", "1222 to 1246"),
        (0.35, "1234", "1234 to 1235"),
        (0.00035, "1234", "narrower than the last digit"),
    ],
)
def test_a_large_value_keeps_its_whole_digits_however_wide_its_interval(
    half: float, said: str, interval: str
) -> None:
    assert format_with_interval(1234.4, 1234.4 - half, 1234.4 + half) == (said, interval)


@pytest.mark.parametrize("power", range(-5, 6))
def test_an_interval_shows_both_ends_apart_at_every_size(power: int) -> None:
    """Two digits of the half width at any unit, up to four digits of the value and six decimals."""
    value, half = 3.0 * 10.0**power, 0.4 * 10.0**power
    said, interval = format_with_interval(value, value - half, value + half)
    low, high = (float(one.replace(MINUS_SIGN, "-")) for one in interval.split(" to "))
    assert float(said) == pytest.approx(value, rel=1e-6)
    assert (low, high) == pytest.approx((2.6 / 3.0 * value, 3.4 / 3.0 * value))


# --- What the pictures are drawn from: residuals before and after, the axis chosen, where an
# effect is held ----------


def test_true_cause_takes_the_dependence_away(
    run_columns: dict[str, Any], machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    view = make_run_views(run_columns, machine)[0]
    parts = list_effect_instances([cause_of("shaft.voltage_sag", 5.0)])
    axis = view.axes["supply_v"]
    before, after = (
        calc_binned_means(axis, view.calc_residual(())),
        calc_binned_means(axis, view.calc_residual(parts)),
    )
    lost = np.mean([40.0, 60.0, 50.0, 12.0]) * 0.05 * np.maximum(0.0, 13.5 - before.at)
    assert np.median(np.abs(before.mean + lost)) < 0.3 and before.mean.min() < -1.5
    # changes of speed are a little other than the model's
    assert np.median(np.abs(after.mean)) < 0.2


def test_axis_is_chosen_by_what_the_effect_does(
    run_columns: dict[str, Any], machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    views = {view.name: view for view in make_run_views(run_columns, machine)}
    assert tuple(views) == ("shaft", "gate", "flow", "scale", "speed", "heads")
    for name, effect_id, wanted in (
        ("shaft", "shaft.voltage_sag", "supply, V"),
        ("flow", "flow.slope", "pitch, degrees nose up"),
        ("heads", "canopy.head_fouled", "head"),
    ):
        part = list_effect_instances([cause_of(effect_id)])[0]
        effect = views[name].calc_part_effect((part,), part)
        assert views[name].find_effect_axis(part, effect).label == wanted
    assert 0.0 < MIN_EFFECT_SHARE_IN_MEANS < 1.0


def test_time_is_the_axis_where_it_matters(
    run_columns: dict[str, Any], machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    views = {view.name: view for view in make_run_views(run_columns, machine)}
    for name, cause, wanted in (
        ("shaft", cause_of("shaft.gain", -3.0, onset_s=120.0), "time, min"),
        ("scale", cause_of("scale.drift", 3.0), "time, min"),
        ("flow", cause_of("flow.hopper_head", 5.0), "hopper, kg"),
    ):
        part = list_effect_instances([cause])[0]
        assert (
            views[name].find_effect_axis(part, views[name].calc_part_effect((part,), part)).label
            == wanted
        )


def test_flow_is_in_grams_a_second(run_columns: dict[str, Any], machine: Machine) -> None:
    flow = next(view for view in make_run_views(run_columns, machine) if view.name == "flow")
    means = flow.calc_axis_means(ResidualAxis("", np.zeros(len(flow.measured))), flow.measured, 0.0)
    used = run_columns["hopper_kg"][:50].mean() - run_columns["hopper_kg"][-50:].mean()
    assert means.mean[0] == pytest.approx(
        1000.0 * used / (run_columns["time_s"][-1] - 5.0), rel=0.06
    )


def test_what_ends_or_grows_is_drawn_so(
    run_columns: dict[str, Any], machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    view = next(view for view in make_run_views(run_columns, machine) if view.name == "gate")
    cause = cause_of("gate.offset", 1.0, onset_s=60.0)
    for changes, wanted in (
        ({"until_s": 120.0}, (0.0, 1.0, 0.0, 0.0)),
        ({"grows": True}, (0.0, 0.08, 0.58, 0.94)),
    ):
        part = list_effect_instances([replace(cause, **changes)])[0]
        effect = view.calc_part_effect((part,), part)
        seen = [effect[np.searchsorted(view.time_s, at_s)] for at_s in (50.0, 75.0, 165.0, 230.0)]
        assert np.abs(seen) == pytest.approx(wanted, abs=0.02)


def test_effect_with_an_onset_begins_there(
    run_columns: dict[str, Any], machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    part = list_effect_instances([cause_of("shaft.stall")])[0]
    assert part.onset_s == 120.0
    shaft = make_run_views(run_columns, machine)[0]
    change = shaft.predict((part,)) - shaft.predict(())
    assert (
        np.all(change[shaft.time_s < 119.0] == 0.0) and change[shaft.time_s > 122.0].min() < -50.0
    )


def test_size_unknown_is_not_drawn(cause_of: Callable[..., Cause]) -> None:
    cause = cause_of("flow.gain")
    assert list_effect_instances([replace(cause, size=replace(cause.size, value=None))]) == ()


def test_table_lines_are_the_two_machines(
    bench_tables: dict[str, BenchTable], machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    (view,) = make_table_views([bench_tables["lag"]], machine, [cause_of("lag.offset", 0.3)])
    assert view.extended - view.nominal == pytest.approx(0.3)
    assert np.abs(view.before).mean() > 0.2 and np.abs(view.after).mean() < 0.05
    assert view.main == "shaft_rpm"


def test_effect_of_one_label_is_held_there_only(
    machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    rpm = np.tile(np.arange(10.0, 71.0, 10.0), 2)
    label = np.array(["field"] * 7 + ["rig"] * 7)
    nominal = make_table_views(
        [BenchTable("lag", {"shaft_rpm": rpm, "lag_s": 0.0 * rpm})], machine, []
    )[0].nominal
    noise = 0.01 * np.random.default_rng(6).standard_normal(14)
    lag = nominal + np.where(label == "field", 0.3, 0.0) + noise
    table = BenchTable("lag", {"shaft_rpm": rpm, "lag_s": lag}, "source", "t.csv", label)
    (view,) = make_table_views([table], machine, [cause_of("lag.offset", 0.3, scope="t.csv field")])
    assert [(g.label, g.held, g.not_held) for g in view.groups] == [
        ("field", ("lag.offset",), ()),
        ("rig", (), ("lag.offset",)),
    ]
    assert np.abs(view.after).max() < 0.05
    (everywhere,) = make_table_views([table], machine, [cause_of("lag.offset", 0.3)])
    assert [(g.label, g.held) for g in everywhere.groups] == [
        ("field", ("lag.offset",)),
        ("rig", ("lag.offset",)),
    ]


def test_the_scope_that_a_diagnosis_tells_is_the_one_that_is_shown(machine: Machine) -> None:
    rpm = np.tile(np.repeat(np.arange(10.0, 71.0, 10.0), 3), 2)
    label = np.array(["field"] * 21 + ["rig"] * 21)
    nominal = make_table_views(
        [BenchTable("lag", {"shaft_rpm": rpm, "lag_s": 0.0 * rpm})], machine, []
    )[0].nominal
    lag = (
        nominal
        + np.where(label == "field", 0.3, 0.0)
        + 0.01 * np.random.default_rng(6).standard_normal(42)
    )
    table = BenchTable("lag", {"shaft_rpm": rpm, "lag_s": lag}, "source", "bench/t.csv", label)
    found = diagnose_tables([table], machine)
    (view,) = make_table_views([table], machine, found.causes)
    assert [cause.scope for cause in found.causes] == ["t.csv field"]
    assert [group.label for group in view.groups if group.held] == ["field"]


def test_the_setting_that_the_effect_follows_is_shown(
    bench_tables: dict[str, BenchTable], machine: Machine, cause_of: Callable[..., Cause]
) -> None:
    (fouled,) = make_table_views(
        [bench_tables["heads"]], machine, [cause_of("canopy.head_fouled", -10.0)]
    )
    (dense,) = make_table_views(
        [bench_tables["heads"]], machine, [cause_of("canopy.saturation", 20.0)]
    )
    assert (fouled.main, dense.main) == ("head", "ndvi_reference")
