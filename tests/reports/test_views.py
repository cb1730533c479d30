"""What the pictures are drawn from: residuals before and after, the axis chosen, where an effect is held."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from console.reports.binned import Axis, binned
from console.reports.run_pictures import LEAST_SHARE
from console.reports.run_views import parts_of, run_views
from console.reports.table_views import table_views
from control.calibration.bench_table import BenchTable
from control.diagnosis import diagnose_tables
from control.diagnosis.result import Cause
from control.machine.machine import Machine


def test_true_cause_takes_the_dependence_away(run_columns: dict[str, Any], machine: Machine,
                                              cause_of: Callable[..., Cause]) -> None:
    view = run_views(run_columns, machine)[0]
    parts = parts_of([cause_of("shaft.voltage_sag", 5.0)])
    axis = view.axes["supply_v"]
    before, after = binned(axis, view.residual(())), binned(axis, view.residual(parts))
    lost = np.mean([40.0, 60.0, 50.0, 12.0]) * 0.05 * np.maximum(0.0, 13.5 - before.at)
    assert np.median(np.abs(before.mean + lost)) < 0.3 and before.mean.min() < -1.5
    assert np.median(np.abs(after.mean)) < 0.2          # changes of speed are a little other than the model's


def test_axis_is_chosen_by_what_the_effect_does(run_columns: dict[str, Any], machine: Machine,
                                                cause_of: Callable[..., Cause]) -> None:
    views = {view.name: view for view in run_views(run_columns, machine)}
    assert tuple(views) == ("shaft", "gate", "flow", "scale", "speed", "heads")
    for name, effect_id, wanted in (("shaft", "shaft.voltage_sag", "supply, V"),
                                    ("flow", "flow.slope", "pitch, degrees nose up"),
                                    ("heads", "canopy.head_fouled", "head")):
        part = parts_of([cause_of(effect_id)])[0]
        effect = views[name].effect((part,), part)
        assert views[name].axis_of(part, effect).label == wanted
    assert 0.0 < LEAST_SHARE < 1.0


def test_time_is_the_axis_where_it_matters(run_columns: dict[str, Any], machine: Machine,
                                           cause_of: Callable[..., Cause]) -> None:
    views = {view.name: view for view in run_views(run_columns, machine)}
    for name, cause, wanted in (("shaft", cause_of("shaft.gain", -3.0, onset_s=120.0), "time, min"),
                                ("scale", cause_of("scale.drift", 3.0), "time, min"),
                                ("flow", cause_of("flow.hopper_head", 5.0), "hopper, kg")):
        part = parts_of([cause])[0]
        assert views[name].axis_of(part, views[name].effect((part,), part)).label == wanted


def test_flow_is_in_grams_a_second(run_columns: dict[str, Any], machine: Machine) -> None:
    flow = next(view for view in run_views(run_columns, machine) if view.name == "flow")
    means = flow.means(Axis("", np.zeros(len(flow.measured))), flow.measured, 0.0)
    used = run_columns["hopper_kg"][:50].mean() - run_columns["hopper_kg"][-50:].mean()
    assert means.mean[0] == pytest.approx(1000.0 * used / (run_columns["time_s"][-1] - 5.0), rel=0.06)


def test_what_ends_or_grows_is_drawn_so(run_columns: dict[str, Any], machine: Machine,
                                        cause_of: Callable[..., Cause]) -> None:
    view = next(view for view in run_views(run_columns, machine) if view.name == "gate")
    cause = cause_of("gate.offset", 1.0, onset_s=60.0)
    for changes, wanted in (({"until_s": 120.0}, (0.0, 1.0, 0.0, 0.0)), ({"grows": True}, (0.0, 0.08, 0.58, 0.94))):
        part = parts_of([replace(cause, **changes)])[0]
        effect = view.effect((part,), part)
        seen = [effect[np.searchsorted(view.time_s, at_s)] for at_s in (50.0, 75.0, 165.0, 230.0)]
        assert np.abs(seen) == pytest.approx(wanted, abs=0.02)


def test_effect_with_an_onset_begins_there(run_columns: dict[str, Any], machine: Machine,
                                           cause_of: Callable[..., Cause]) -> None:
    part = parts_of([cause_of("shaft.stall")])[0]
    assert part.onset_s == 120.0
    shaft = run_views(run_columns, machine)[0]
    change = shaft.predict((part,)) - shaft.predict(())
    assert np.all(change[shaft.time_s < 119.0] == 0.0) and change[shaft.time_s > 122.0].min() < -50.0


def test_size_unknown_is_not_drawn(cause_of: Callable[..., Cause]) -> None:
    cause = cause_of("flow.gain")
    assert parts_of([replace(cause, size=replace(cause.size, value=None))]) == ()


def test_table_lines_are_the_two_machines(bench_tables: dict[str, BenchTable], machine: Machine,
                                          cause_of: Callable[..., Cause]) -> None:
    view, = table_views([bench_tables["lag"]], machine, [cause_of("lag.offset", 0.3)])
    assert view.extended - view.nominal == pytest.approx(0.3)
    assert np.abs(view.before).mean() > 0.2 and np.abs(view.after).mean() < 0.05
    assert view.main == "shaft_rpm"


def test_effect_of_one_label_is_held_there_only(machine: Machine, cause_of: Callable[..., Cause]) -> None:
    rpm = np.tile(np.arange(10.0, 71.0, 10.0), 2)
    label = np.array(["field"] * 7 + ["rig"] * 7)
    nominal = table_views([BenchTable("lag", {"shaft_rpm": rpm, "lag_s": 0.0 * rpm})], machine, [])[0].nominal
    noise = 0.01 * np.random.default_rng(6).standard_normal(14)
    lag = nominal + np.where(label == "field", 0.3, 0.0) + noise
    table = BenchTable("lag", {"shaft_rpm": rpm, "lag_s": lag}, "source", "t.csv", label)
    view, = table_views([table], machine, [cause_of("lag.offset", 0.3, scope="t.csv field")])
    assert [(g.label, g.held, g.not_held) for g in view.groups] == [("field", ("lag.offset",), ()),
                                                                    ("rig", (), ("lag.offset",))]
    assert np.abs(view.after).max() < 0.05
    everywhere, = table_views([table], machine, [cause_of("lag.offset", 0.3)])
    assert [(g.label, g.held) for g in everywhere.groups] == [("field", ("lag.offset",)), ("rig", ("lag.offset",))]


def test_the_scope_that_a_diagnosis_tells_is_the_one_that_is_shown(machine: Machine) -> None:
    rpm = np.tile(np.repeat(np.arange(10.0, 71.0, 10.0), 3), 2)
    label = np.array(["field"] * 21 + ["rig"] * 21)
    nominal = table_views([BenchTable("lag", {"shaft_rpm": rpm, "lag_s": 0.0 * rpm})], machine, [])[0].nominal
    lag = nominal + np.where(label == "field", 0.3, 0.0) + 0.01 * np.random.default_rng(6).standard_normal(42)
    table = BenchTable("lag", {"shaft_rpm": rpm, "lag_s": lag}, "source", "bench/t.csv", label)
    found = diagnose_tables([table], machine)
    view, = table_views([table], machine, found.causes)
    assert [cause.scope for cause in found.causes] == ["t.csv field"]
    assert [group.label for group in view.groups if group.held] == ["field"]


def test_the_setting_that_the_effect_follows_is_shown(bench_tables: dict[str, BenchTable], machine: Machine,
                                                      cause_of: Callable[..., Cause]) -> None:
    fouled, = table_views([bench_tables["heads"]], machine, [cause_of("canopy.head_fouled", -10.0)])
    dense, = table_views([bench_tables["heads"]], machine, [cause_of("canopy.saturation", 20.0)])
    assert (fouled.main, dense.main) == ("head", "ndvi_reference")
