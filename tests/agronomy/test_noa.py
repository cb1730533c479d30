"""The nitrogen optimisation against paper A's own figures, and within its bounds everywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.head_fusion import (
    FusedNdvi,
    FusionLimits,
    FusionState,
    fuse_readings,
    start_fusion,
)
from topdress.control.agronomy.nitrogen_rate import (
    calc_insey,
    calc_requirement_kg_ha,
    calc_response_index,
    calc_yield_without_t_ha,
    decide_rate_kg_ha,
    grade_ndvi,
    list_grade_edges,
    make_rate_table,
    prepare_rule,
)
from topdress.control.agronomy.sampling_frequency import (
    FREQUENCIES_HZ,
    ReadingUniformity,
    calc_cuc_percent,
    calc_cv_percent,
    choose_frequency,
    measure_evenness,
    subsample_readings,
    tabulate_frequencies,
)
from topdress.control.papers.decision_paper_claims import (
    calc_extra_nitrogen,
    calc_weighed_rate,
)
from topdress.control.readings import Reading


def smooth(crop: Crop) -> Crop:
    """Without grades, by the paper's response index, with hard ends."""
    return crop.model_copy(update={"grades": False, "response_index": "paper", "taper_ndvi": 0.0})


def test_table_2_comes_back_from_eq_2_to_4(huanghai):
    """Targets of plots FA, FB, FC: 22.0, 20.2, 18.9 kg on 600 m2."""
    for ndvi, kg in ((0.499, 22.0), (0.530, 20.2), (0.551, 18.9)):
        assert decide_rate_kg_ha(smooth(huanghai), ndvi) == pytest.approx(kg / 0.06, abs=1.0)


def test_printed_eq_2_is_negative_where_the_rate_is_zero(huanghai):
    without = calc_yield_without_t_ha(calc_insey(0.75, 82), 0.359, 324.4)
    assert calc_requirement_kg_ha(6.73, without) == pytest.approx(-21.9, abs=0.05)
    decision = prepare_rule(huanghai).decide_rate(0.75)
    assert (decision.rate_kg_ha, decision.why, decision.grade) == (0.0, "yield_reached", 10)


def test_fewer_days_more_yield_expected_less_urea(huanghai):
    """What the day rule is worth: 82 days give 366 kg/ha at NDVI 0.5, 65 days 210."""
    assert decide_rate_kg_ha(smooth(huanghai), 0.5, days=82) == pytest.approx(366.0, abs=0.5)
    assert decide_rate_kg_ha(smooth(huanghai), 0.5, days=65) == pytest.approx(210.0, abs=0.5)


def test_eq_2_by_hand():
    assert calc_requirement_kg_ha(6.0, 5.0, 23.9, 0.45, 0.6) == pytest.approx(23.9 / 0.27)
    assert calc_requirement_kg_ha(6.0, 5.0, 23.9, 0.46, 0.5) == pytest.approx(23.9 / 0.23)


def test_cut_offs(huanghai):
    rule, graded = prepare_rule(smooth(huanghai)), prepare_rule(huanghai)
    assert rule.decide_rate(0.2499).why == graded.decide_rate(0.2499).why == "below_cutoff"
    assert rule.decide_rate(0.7501).why == graded.decide_rate(0.7501).why == "above_cutoff"
    # the print: zero below 0.25 only ...
    assert rule.decide_rate(0.25).rate_kg_ha > 500.0 - 1e-9
    assert graded.decide_rate(0.25).rate_kg_ha == 0.0  # ... but the first grade is (0.25, 0.3]
    assert graded.decide_rate(0.2501).rate_kg_ha == pytest.approx(491.6, abs=0.05)


@pytest.mark.parametrize("nothing", [None, math.nan, math.inf, -math.inf])
def test_no_reading_is_no_rate(huanghai, nothing):
    assert prepare_rule(huanghai).decide_rate(nothing).why == "no_ndvi"
    assert decide_rate_kg_ha(huanghai, nothing) == 0.0


def test_eleven_grades_each_at_its_upper_edge(huanghai):
    edges = list_grade_edges()
    assert edges == (0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75)
    grades = {grade_ndvi(n / 1000).grade for n in range(1001)}
    assert grades == set(range(11))
    for grade, edge in enumerate(edges, start=1):
        assert grade_ndvi(edge).grade == grade
        # a median of floats may sit this close
        assert grade_ndvi(edge + 1e-12).grade == grade
        assert grade_ndvi(edge - 0.049).grade == grade
        assert grade_ndvi(edge).ndvi == pytest.approx(edge)
    assert prepare_rule(huanghai).decide_rate(0.511).rate_kg_ha == decide_rate_kg_ha(
        smooth(huanghai), 0.55
    )


def test_rate_table_is_what_the_rule_does(huanghai):
    table = make_rate_table(huanghai)
    rule = prepare_rule(huanghai)
    assert [line.grade for line in table] == list(range(1, 11))
    assert table[0].ndvi_above == 0.25 and table[-1].ndvi_to == 0.75
    for line in table:
        assert rule.decide_rate((line.ndvi_above + line.ndvi_to) / 2).rate_kg_ha == line.rate_kg_ha
    assert table[4].rate_kg_ha == pytest.approx(366.0, abs=0.5)


def test_response_index_is_capped():
    assert calc_response_index(0.8, 0.5) == pytest.approx(1.6)
    assert calc_response_index(0.8, 0.3) == 2.0
    assert calc_response_index(0.8, 0.0) == 2.0


def test_n_rich_form(oklahoma):
    """Eq 5: yield with nitrogen is yield without times RI, at most Y_max."""
    crop = smooth(oklahoma)
    decision = prepare_rule(crop, days=100, ndvi_nrich=0.65).decide_rate(0.5)
    assert decision.response_index == pytest.approx(1.3)
    assert decision.yield_without_t_ha == pytest.approx(0.359 * math.exp(324.4 * 0.005))
    assert decision.yield_with_t_ha == pytest.approx(1.3 * 0.359 * math.exp(1.622))
    assert decision.rate_kg_ha == pytest.approx(23.9 * 0.3 * 0.359 * math.exp(1.622) / 0.27)
    assert prepare_rule(crop, 100, 0.65).decide_rate(0.3).response_index == 2.0
    assert prepare_rule(crop, 100, 0.65).decide_rate(0.7).why == "yield_reached"


def test_y_max_tames_the_exponential(oklahoma):
    """Few days and a dense canopy: without Y_max eq 3 gives 46 t/ha here."""
    crop = smooth(oklahoma)
    decision = prepare_rule(crop, days=30, ndvi_nrich=0.6).decide_rate(0.45)
    assert 0.359 * math.exp(324.4 * 0.45 / 30) > 40.0
    assert decision.yield_with_t_ha == crop.y_max_t_ha
    assert decision.rate_kg_ha == 0.0
    # what is shown is no 46 t/ha either
    assert decision.yield_without_t_ha == crop.y_max_t_ha
    partly = prepare_rule(crop, days=60, ndvi_nrich=0.75).decide_rate(0.5)
    assert partly.yield_with_t_ha == crop.y_max_t_ha
    assert partly.rate_kg_ha == pytest.approx(23.9 * (7.0 - partly.yield_without_t_ha) / 0.27)


def test_the_strip_decides_where_both_are_given(huanghai):
    assert prepare_rule(huanghai, ndvi_nrich=0.6).decide_rate(0.5).response_index == pytest.approx(
        1.2
    )
    assert prepare_rule(huanghai).decide_rate(0.5).response_index is None


def test_what_cannot_be_prepared_says_why(crop_data, oklahoma):
    without = Crop.model_validate(
        crop_data("osu_winter_wheat_2004") | {"ndvi_nrich": None, "response_index": "paper"}
    )
    with pytest.raises(ValueError, match="ndvi_nrich and fixed_yield_t_ha both missing"):
        prepare_rule(without)
    by_weather = Crop.model_validate(
        crop_data("osu_winter_wheat_2004") | {"days": {"weather": "w.csv", "sown": "2013-11-01"}}
    )
    with pytest.raises(ValueError, match=r"to be counted from w\.csv"):
        prepare_rule(by_weather)
    assert prepare_rule(by_weather, days=90).days == 90
    for days in (0, -3, 401):
        with pytest.raises(ValueError, match="allowed is 1 to 400"):
            prepare_rule(oklahoma, days=days)
    with pytest.raises(ValueError, match="ndvi_nrich"):
        prepare_rule(oklahoma, ndvi_nrich=1.5)
    with pytest.raises(ValueError, match="days 0"):
        calc_insey(0.5, 0)


def test_limit_of_the_product_holds(huanghai):
    small = huanghai.model_copy(update={"max_rate_kg_ha": 200.0})
    decision = prepare_rule(small).decide_rate(0.4)
    assert (decision.rate_kg_ha, decision.why) == (200.0, "limited")


def _crop(grades: bool, eta: float) -> Crop:
    return Crop.model_validate(
        {
            "format": "topdress-crop/1",
            "id": "any_wheat",
            "name": "any",
            "yield_potential": {"set": "osu_durum_2006"},
            "days": {"count": 100, "above_c": 4.4},
            "y_max_t_ha": 9.0,
            "fixed_yield_t_ha": 6.0,
            "efficiency": eta,
            "grades": grades,
            "ndvi_max": 0.75,
            "fallback_rate_kg_ha": 50.0,
            "max_rate_kg_ha": 300.0,
        }
    )


@settings(deadline=None)
@given(
    ndvi=st.floats(allow_nan=True, allow_infinity=True),
    days=st.integers(1, 400),
    nrich=st.none() | st.floats(0.01, 0.95),
    grades=st.booleans(),
    eta=st.floats(0.5, 0.7),
)
def test_never_negative_never_above_the_limit(ndvi, days, nrich, grades, eta):
    crop = _crop(grades, eta)
    rate = decide_rate_kg_ha(crop, ndvi, days, nrich)
    assert math.isfinite(rate)
    assert 0.0 <= rate <= 300.0
    if not 0.25 - 1e-9 <= ndvi <= 0.75 + 1e-9:
        assert rate == 0.0


@settings(deadline=None)
@given(st.floats(0.26, 0.74), st.floats(0.0, 0.2))
def test_fixed_yield_form_falls_with_ndvi(ndvi, more):
    without = [
        calc_yield_without_t_ha(calc_insey(n, 82), 0.359, 324.4) for n in (ndvi, ndvi + more)
    ]
    assert calc_requirement_kg_ha(6.73, without[0]) >= calc_requirement_kg_ha(6.73, without[1])


# --- Evenness of a canopy, and the paper's choice of 1 Hz from its own table
# -----------------------------------------


def test_by_hand():
    values = [0.4, 0.5, 0.6]
    assert calc_cv_percent(values) == pytest.approx(100 * 0.1 / 0.5)
    assert calc_cuc_percent(values) == pytest.approx(100 * (1 - 0.2 / 1.5))
    assert measure_evenness(values).mean == pytest.approx(0.5)


def test_gaps_are_left_out_and_nothing_gives_nan():
    assert measure_evenness([0.4, math.nan, 0.5, 0.6]) == measure_evenness([0.4, 0.5, 0.6])
    assert math.isnan(calc_cv_percent([0.5]))
    assert math.isnan(calc_cuc_percent([]))
    assert math.isnan(calc_cuc_percent([-0.1, 0.05]))
    assert measure_evenness([]).n == 0


@settings(deadline=None)
@given(st.lists(st.floats(0.1, 0.9), min_size=2, max_size=50), st.floats(0.1, 10.0))
def test_scale_free(values, factor):
    scaled = [value * factor for value in values]
    assert calc_cv_percent(scaled) == pytest.approx(calc_cv_percent(values), abs=1e-9)
    assert calc_cuc_percent(scaled) == pytest.approx(calc_cuc_percent(values), abs=1e-9)
    assert calc_cuc_percent(values) <= 100.0 + 1e-12


def test_subsample():
    assert list(subsample_readings(range(9), 2.0, 0.5)) == [0, 4, 8]
    assert list(subsample_readings(range(3), 2.0, 2.0)) == [0, 1, 2]
    for target in (3.0, 1.5, 0.0, -1.0):
        with pytest.raises(ValueError, match="allowed"):
            subsample_readings(range(9), 2.0, target)


def test_a_column_of_table_1():
    readings = 0.5 + 0.05 * np.random.default_rng(1).standard_normal(400)
    table = tabulate_frequencies(readings)
    assert tuple(table) == FREQUENCIES_HZ
    assert [table[hz].n for hz in FREQUENCIES_HZ] == [400, 200, 100, 50, 25]
    assert table[1.0] == measure_evenness(readings[::2])


def test_the_paper_chooses_1_hz(paper_table):
    plots: dict[str, dict[float, ReadingUniformity]] = {}
    for row in paper_table("decision_table1_sampling.csv"):
        plots.setdefault(row["plot"], {})[float(row["frequency_hz"])] = ReadingUniformity(
            0, math.nan, float(row["cv_percent"]), float(row["cuc_percent"])
        )
    assert len(plots) == 12
    choice = choose_frequency(list(plots.values()))
    assert choice.frequency_hz == 1.0
    assert choice.departure[1.0] == pytest.approx(0.791 + 0.459, abs=0.002)
    assert choice.departure[0.5] == pytest.approx(1.099 + 0.693, abs=0.002)
    assert sorted(choice.departure, key=choice.departure.__getitem__) == [1.0, 0.5, 0.25, 0.125]


def test_a_table_of_our_own_where_the_slowest_is_as_good():
    same = ReadingUniformity(10, 0.5, 8.0, 93.0)
    other = ReadingUniformity(10, 0.5, 9.0, 93.0)
    assert choose_frequency([{2.0: same, 1.0: same, 0.5: same}]).frequency_hz == 0.5
    assert choose_frequency([{2.0: same, 1.0: other, 0.5: same}]).frequency_hz == 0.5
    assert choose_frequency([{2.0: same, 1.0: same, 0.5: other}]).frequency_hz == 1.0
    with pytest.raises(ValueError, match="lower frequency"):
        choose_frequency([{2.0: same}])
    with pytest.raises(ValueError, match="lower frequency"):
        choose_frequency([])


# --- Table 2 of paper A: which of its columns the abstract's 28 kg N/ha comes from
# -----------------------------------


def test_28_kg_more_nitrogen_is_of_the_applied_amounts(paper_table):
    rows = paper_table("decision_table2_applied.csv")
    extra = {
        column: calc_extra_nitrogen(
            [calc_weighed_rate(float(row[column]), float(row["area_m2"])) for row in rows],
            300.0,
        )
        for column in ("applied_kg", "target_kg")
    }
    assert extra["applied_kg"] == pytest.approx(28.75)
    assert extra["target_kg"] == pytest.approx(17.75)


def test_by_hand_and_refused():
    assert calc_weighed_rate(22.0, 600.0) == pytest.approx(366.7, abs=0.05)
    assert calc_extra_nitrogen([100.0, 200.0], 100.0, 0.5) == 25.0
    with pytest.raises(ValueError, match="area 0"):
        calc_weighed_rate(1.0, 0.0)
    with pytest.raises(ValueError, match="no plots"):
        calc_extra_nitrogen([], 300.0)


# --- Fusion of the heads: one bad head never reaches the decision, and is named
# --------------------------------------


def fuse(state, values, time_s):
    """One step with values that were all read now."""
    return fuse_readings(
        state, tuple(None if v is None else Reading(v, time_s) for v in values), time_s
    )


def run(rows, period_s=0.5, state=None, from_s=0.0):
    """Fuse rows of six values at a period; the last state, and every result."""
    state, results = state or start_fusion(6), []
    for k, row in enumerate(rows):
        state, fused = fuse(state, row, from_s + k * period_s)
        results.append(fused)
    return state, results


def test_median_of_six():
    _, (fused,) = run([[0.50, 0.52, 0.48, 0.51, 0.49, 0.53]])
    assert fused == FusedNdvi(pytest.approx(0.505), 6, (), (), (), False)


GOOD, BAD = [0.5] * 6, [0.5, 0.51, 0.75, 0.49, 0.5, 0.52]
# rows of the heads, two a second, and who is dropped after each
DROPPED = {
    "one wild reading": ([GOOD, [0.5, 0.5, 0.9, 0.5, 0.5, 0.5], GOOD, GOOD], [()] * 4),
    "after two seconds": ([BAD] * 8, [()] * 4 + [(3,)] * 4),
    "begun anew": ([BAD, BAD, BAD, GOOD] * 2, [()] * 8),
    "two at once": ([[0.5, 0.51, 0.75, 0.49, 0.2, 0.52]] * 8, [()] * 4 + [(3, 5)] * 4),
    # three heads over bare soil, three over wheat: neither side outvotes the other
    "an edge of the field": ([[0.2, 0.21, 0.19, 0.6, 0.61, 0.62]] * 20, [()] * 20),
    "a slope across the machine": ([[0.3, 0.36, 0.42, 0.48, 0.54, 0.60]] * 20, [()] * 20),
}


@pytest.mark.parametrize("case", DROPPED)
def test_who_disagrees_is_dropped_and_named(case):
    rows, dropped = DROPPED[case]
    _, results = run(rows)
    assert [fused.dropped for fused in results] == dropped
    assert all(fused.disagreeing == fused.dropped and fused.silent == () for fused in results)
    assert all(fused.valid == 6 - len(fused.dropped) and not fused.degraded for fused in results)
    assert (
        "edge" in case
        or "slope" in case
        or all(fused.ndvi == pytest.approx(0.5, abs=0.006) for fused in results)
    )


@pytest.mark.parametrize(
    ("row", "degraded", "ndvi"),
    [
        ([0.5, 0.5, 0.5, None, None, None], True, 0.5),
        ([0.5, 0.5, 0.5, 0.5, None, None], False, 0.5),
        ([None] * 6, True, None),
    ],
)
def test_fewer_than_four_is_degraded_and_none_is_none(row, degraded, ndvi):
    _, (fused,) = run([row])
    assert (fused.degraded, fused.ndvi) == (degraded, ndvi) and fused.valid == 6 - row.count(None)
    assert fused.dropped == tuple(k for k, one in enumerate(row, start=1) if one is None)


def test_a_dropped_head_comes_back_only_after_five_close_seconds():
    bad, near, good = ([0.5, 0.5, v, 0.5, 0.5, 0.5] for v in (0.75, 0.56, 0.51))
    state, _ = run([bad] * 6)
    # within 0.08, not within half of it
    state, results = run([near] * 20, state=state, from_s=3.0)
    assert all(fused.dropped == (3,) for fused in results)
    _, results = run([good] * 13, state=state, from_s=13.0)
    assert [fused.dropped for fused in results] == [(3,)] * 10 + [()] * 3


def test_a_silent_head_is_dropped_by_age_and_returns_with_its_next_reading():
    row = [0.5, None, 0.5, 0.5, 0.5, 0.5]
    state, _ = run([[0.5] * 6])
    state, results = run([row] * 4, state=state, from_s=0.5)
    assert [fused.silent for fused in results] == [(), (), (2,), (2,)]
    _, fused = fuse(state, [0.5] * 6, 2.5)
    assert fused.dropped == ()


def test_two_heads_cannot_judge_each_other():
    state = start_fusion(2)
    for k in range(10):
        state, fused = fuse(state, [0.3, 0.7], 0.5 * k)
    assert fused.dropped == ()


@pytest.mark.parametrize("nonsense", [float("nan"), float("inf"), -1.0, 1.5])
def test_a_value_that_is_no_ndvi_is_no_reading(nonsense):
    _, (fused,) = run([[0.5, nonsense, 0.5, 0.5, 0.5, 0.5]])
    assert fused.ndvi == 0.5 and fused.silent == (2,)


def test_held_readings_at_the_loops_rate_are_the_same_as_their_own_times():
    """At 20 Hz the same 2 Hz readings are seen ten times; nothing may come sooner or later for
    it."""
    state, dropped_at = start_fusion(6), None
    for tick in range(100):
        now = 0.05 * tick
        sampled = 0.5 * int(now / 0.5 + 1e-9)
        readings = [Reading(v, sampled) for v in (0.5, 0.51, 0.75, 0.49, 0.5, 0.52)]
        state, fused = fuse_readings(state, readings, now)
        if fused.dropped and dropped_at is None:
            dropped_at = now
    assert dropped_at == pytest.approx(2.0)


def test_noise_drops_nobody_in_an_hour():
    rng = np.random.default_rng(7)
    truth = 0.5 + 0.1 * np.sin(np.arange(7200) / 40.0)
    rows = truth[:, None] + 0.01 * rng.standard_normal((7200, 6))
    _, results = run(rows.tolist())
    assert not any(fused.dropped for fused in results)
    error = np.array([fused.ndvi for fused in results]) - truth
    assert float(np.std(error)) < 0.0065


@settings(deadline=None)
@given(
    st.lists(st.lists(st.none() | st.floats(allow_nan=True), min_size=6, max_size=6), max_size=30),
    st.floats(0.01, 3.0),
)
def test_whatever_is_said_the_answer_is_sound(rows, period_s):
    limits = FusionLimits()
    state = FusionState()
    for k, row in enumerate(rows):
        state, fused = fuse(state, row, k * period_s)
        assert fused.valid + len(fused.dropped) == 6
        assert set(fused.dropped) == set(fused.disagreeing) | set(fused.silent)
        assert fused.degraded == (fused.valid < limits.least_valid)
        assert (fused.ndvi is None) == (fused.valid == 0)
        assert fused.ndvi is None or limits.ndvi_low <= fused.ndvi <= limits.ndvi_high
