"""`topdress reproduce`: published figures as printed, ours beside them, and which reading of
the text they follow."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from topdress.console.cli import app
from topdress.control.agronomy.crop import Crop
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.landing import calc_carried_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.start_lag import calc_response_s, find_first_fall_s, find_start_lag_s
from topdress.control.papers import published
from topdress.control.papers.correction_experiment import (
    IN_PHASE,
    INTERPRETATIONS,
    ONCE_A_SECOND,
    calc_exceedance_share,
    compare_interpretations,
    fit_field_rival,
    simulate_misses,
)
from topdress.control.papers.decision_paper import (
    compare_forward_targets,
    make_nitrogen_table,
    simulate_sampling,
)
from topdress.control.papers.decision_paper_claims import (
    list_decision_claims,
    list_grain_nitrogen,
    make_yield_table,
)
from topdress.control.papers.lag_experiments import compare_speed_and_delay, make_experiment_tables
from topdress.control.papers.lag_paper import make_eq3_table, refit_lag_line
from topdress.control.papers.lag_paper_claims import list_lag_claims
from topdress.control.papers.map_geometry import (
    count_agreeing_cells,
    find_paper_cell,
    make_boundary_table,
)
from topdress.control.papers.page import Claim, ResultOrigin, Table, make_claim_table
from topdress.control.papers.paper_elements import (
    DECISION,
    LAG,
    NO,
    PAPER_ELEMENTS,
    PARTLY,
    POINT,
    YES,
)
from topdress.control.papers.point_paper import (
    list_points_claims,
    make_delay_table,
    make_microstep_table,
)
from topdress.control.targets.point_mode import calc_point_lag
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import CROP_KIND

from tests.command import topdress
from tests.places import PAPERS


@pytest.fixture(scope="module")
def crop() -> Crop:
    return load_config("huanghai_wheat", CROP_KIND).model


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_figures_are_typed_as_the_tables_have_them() -> None:
    for row in rows(PAPERS / "lag_table5_corrected.csv"):
        assert published.CORRECTED_M[int(row["shaft_rpm"])][int(row["replicate"]) - 1] == float(
            row["miss_m"]
        )
    for row in rows(PAPERS / "lag_table3_drop_time.csv"):
        assert published.DROP_S[int(row["shaft_rpm"])][int(row["replicate"]) - 1] == float(
            row["drop_s"]
        )
    for row in rows(PAPERS / "lag_table4_total.csv"):
        assert published.TOTAL_LAG_S[int(row["shaft_rpm"])][row["source"] == "detected"] == float(
            row["lag_s"]
        )
    for row in rows(PAPERS / "decision_table1_sampling.csv"):
        found = published.SAMPLING_PERCENT[float(row["frequency_hz"])][
            published.PLOT_NAMES.index(row["plot"])
        ]
        assert found == (float(row["cv_percent"]), float(row["cuc_percent"]))
    for row in rows(PAPERS / "decision_table2_applied.csv"):
        assert published.APPLIED_AMOUNTS[row["plot"]][1:3] == (
            float(row["target_kg"]),
            float(row["applied_kg"]),
        )


def test_eq_6_comes_out_of_the_detected_lags() -> None:
    table, _ = refit_lag_line()
    assert table.rows[1][1] == pytest.approx(2.2118, abs=0.01)
    assert table.rows[1][2] == pytest.approx(-8.3e-3, abs=2e-4)
    assert table.rows[2][1] > 2.4


def test_eq_3_as_printed_makes_8_39_m_of_10() -> None:
    east, north, _ = make_eq3_table().rows
    assert east[1] == pytest.approx(8.39, abs=0.05)  # the arccosine keeps few digits
    assert east[2] == pytest.approx(10.0 * (1 - 0.0047), abs=0.03)
    assert east[3] == pytest.approx(10.0, abs=1e-4) and north[3] == pytest.approx(10.0, abs=1e-4)


def test_the_machine_turns_after_the_response_of_table_2() -> None:
    for rpm, values in published.RESPONSE_S.items():
        assert calc_response_s(Machine(), rpm) == pytest.approx(sum(values) / 2, abs=0.01)


def test_eq_6_exact_leaves_nothing_after_the_correction() -> None:
    rng = np.random.default_rng(1)
    for rpm in published.CORRECTION_GAIN_M:
        assert abs(simulate_misses(Machine(), rpm, INTERPRETATIONS[0], True, 1, rng)).max() < 1e-9
        before = simulate_misses(Machine(), rpm, INTERPRETATIONS[0], False, 1, rng).mean()
        assert before == pytest.approx(published.CORRECTION_GAIN_M[rpm][0], abs=0.65)


def test_the_papers_own_test_played_through_the_model_gives_its_tables() -> None:
    speeds = np.arange(10.0, 71.0, 10.0)
    lags = np.array([find_start_lag_s(Machine(), n) for n in speeds])
    assert np.polyfit(speeds, lags, 1)[0] == pytest.approx(-8.3e-3, abs=1e-4)
    detected = np.array([published.TOTAL_LAG_S[int(n)][1] for n in speeds])
    assert np.sqrt(np.mean((lags - detected) ** 2)) < 0.032  # eq 6 itself: 0.031
    (_, _, sums, settled), words = make_experiment_tables(Machine())
    ours = {str(row[0]): row[1:] for row in sums.rows}
    # the model before
    assert ours["table 4 detected, s"][1] == pytest.approx(0.238, abs=0.001)
    assert all(row[0] < 0.05 and row[2] < 0.05 for row in ours.values())
    assert any(
        "speed of the test, km/h" in str(row[0]) and str(row[1]).startswith("5.26")
        for row in settled.rows
    )
    assert "1.996 s)" in words[0]
    assert "a test speed of 1.46 (1.45 to 1.47) m/s, 5.26 km/h where 4.25 is written" in words[1]


def test_nothing_overtakes_in_the_tube_and_a_start_takes_longer_than_a_running_shaft() -> None:
    time = np.arange(0.0, 6.0, 0.05)
    drops = np.where(time < 2.0, 1.8, np.where(time < 4.0, 1.1, 1.6))
    lands = time + calc_carried_s(time, drops)
    assert np.all(np.diff(lands) > 0.0)
    assert calc_carried_s(time, np.full(len(time), 1.3)) == pytest.approx(np.full(len(time), 1.3))
    assert calc_drop_s(Machine().fall, 70.0) == pytest.approx(
        find_first_fall_s(Machine(), Machine().fall, 70.0) - 0.07, abs=0.01
    )


def test_a_position_once_a_second_explains_table_5_and_no_faster_one_does() -> None:
    fits = compare_interpretations(Machine(), published.CORRECTED_M, trials=400)
    assert fits[0].reading.name == ONCE_A_SECOND
    assert fits[0].mean_m == pytest.approx(0.626, abs=0.06)
    worse = [fit for fit in fits if fit.reading.update_hz in (5.0, 10.0)]
    assert all(fit.log_likelihood < fits[0].log_likelihood - 42.0 for fit in worse)


def by_hand(values: tuple[float, ...], rpm: int, shared: bool) -> float:
    """Log likelihood of three misses, by drawing the moment between two positions a second
    apart, 1/m."""
    rng = np.random.default_rng(3)
    phase_s, drops = rng.uniform(0.0, 1.0, 40_000), np.array(published.DROP_S[rpm])
    left_s = drops - drops.mean()
    by_phase = [
        np.exp(-0.5 * ((value - 4.25 / 3.6 * (phase_s[:, None] + left_s)) / 0.05) ** 2).mean(axis=1)
        / (0.05 * np.sqrt(2.0 * np.pi))
        for value in values
    ]
    return float(
        np.log(np.prod(by_phase, axis=0).mean())
        if shared
        else sum(np.log(one.mean()) for one in by_phase)
    )


def test_table_5_refutes_that_replicates_met_the_boundary_alike() -> None:
    """Judged by its 21 values together; value by value the two readings look the same."""
    fits = {
        fit.reading.name: fit
        for fit in compare_interpretations(Machine(), published.CORRECTED_M, trials=50)
    }
    for name, shared, said in ((IN_PHASE, True, -41.1), (ONCE_A_SECOND, False, -9.3)):
        assert fits[name].log_likelihood == pytest.approx(said, abs=0.06)
        drawn = sum(by_hand(values, rpm, shared) for rpm, values in published.CORRECTED_M.items())
        assert fits[name].log_likelihood == pytest.approx(drawn, abs=0.5)
    assert (
        calc_exceedance_share(Machine(), fits[ONCE_A_SECOND].reading, published.CORRECTED_M) < 0.03
    ), "nor does it say all"


def test_a_speed_is_hardly_likelier_than_a_delay_with_the_rigs_slope_uncertain() -> None:
    odds = compare_speed_and_delay()
    assert (odds.speed_kmh, odds.delay_s) == (
        pytest.approx(5.27, abs=0.01),
        pytest.approx(0.453, abs=0.005),
    )
    assert odds.calc_delay_odds == pytest.approx(2.4, abs=0.1)
    assert (
        odds.delay_at_4_5_s == pytest.approx(0.32, abs=0.005)
        and 1.0 < odds.calc_delay_odds_at_4_5 < 1.5
    )


def test_the_rise_is_that_of_a_start_and_not_the_parameter_behind_it() -> None:
    (_, _, _, settled), words = make_experiment_tables(Machine())
    rise = next(str(row[1]) for row in settled.rows if "rise at 100" in str(row[0]))
    assert rise.startswith("0.451 (0.406 to 0.496)")
    assert "2.4 to 1 only" in words[1] and "0.32 s by 1.4 to 1" in words[1]


def test_table_5_is_as_likely_with_two_fitted_spreads_and_no_mechanism() -> None:
    """By the same normal written out with its covariance, at the fitted spreads and near them."""
    rival = fit_field_rival(published.CORRECTED_M)
    assert (rival.between_m, rival.within_m) == (
        pytest.approx(0.316, abs=0.001),
        pytest.approx(0.260, abs=0.001),
    )

    def log_likelihood(between: float, within: float) -> float:
        cov = within**2 * np.eye(3) + between**2
        left = [
            np.array(values)
            - (np.mean(published.LAG_M[rpm]) - 4.25 / 3.6 * (2.2118 - 8.3e-3 * rpm))
            for rpm, values in published.CORRECTED_M.items()
        ]
        return float(
            sum(
                -0.5 * (one @ np.linalg.solve(cov, one) + np.linalg.slogdet(2.0 * np.pi * cov)[1])
                for one in left
            )
        )

    assert rival.log_likelihood == pytest.approx(
        log_likelihood(rival.between_m, rival.within_m), abs=1e-6
    )
    assert all(
        rival.log_likelihood > log_likelihood(rival.between_m * a, rival.within_m * b)
        for a, b in ((0.9, 1.0), (1.1, 1.0), (1.0, 0.9), (1.0, 1.1))
    )
    assert rival.penalised == pytest.approx(-10.5, abs=0.05)


def test_table_3_holds_little_of_the_nitrogen_that_eq_2_takes_to_be_found(crop: Crop) -> None:
    """FA: a third of 225 kg urea and 150 kg of 18-46-0, and 393.3 kg urea; 124.7 kg more grain
    of 2.39 % N."""
    assert [round(100.0 * one.share, 1) for one in list_grain_nitrogen()] == [1.4, 3.0, 8.6]
    assert list_grain_nitrogen()[0].given_kg_ha == pytest.approx(
        (225 * 0.45 + 150 * 0.18) / 3 + 23.6 / 0.06 * 0.45
    )
    said = next(claim for claim in claims_of(crop)["decision"] if claim.where == "eq 2, table 3")
    assert said.agrees is False and said.obtained == "0.014, 0.030, 0.086"


def test_every_element_is_where_the_table_says() -> None:
    root = Path(__file__).parents[2]
    commands = {
        one.name or one.callback.__name__.replace("_", "-") for one in app.registered_commands
    }
    commands |= {one.name for one in app.registered_groups}
    for paper, element, here, where, remark in PAPER_ELEMENTS:
        assert here in (YES, PARTLY, NO) and paper in (DECISION, LAG, POINT)
        assert (where or here == NO) and (remark or here == YES), element
        for place in filter(None, where.split("; ")):
            known = (
                place.split()[1] in commands
                if place.startswith("topdress ")
                else (root / place).exists()
            )
            assert known, (element, place)
    assert {element for _, element, here, _, _ in PAPER_ELEMENTS if here == NO} >= {
        "EDEM simulation of granules",
        "camera and program that see the plant",
    }


def test_28_kg_more_nitrogen_is_of_the_applied_amounts() -> None:
    assert make_nitrogen_table().rows[0] == (28.0, pytest.approx(17.75), pytest.approx(28.75))


@pytest.mark.exam
def test_sampling_prefers_one_hertz_in_both(crop: Crop) -> None:
    (table, changes), words = simulate_sampling(1)
    assert "1 Hz in the paper's figures and 1 Hz in 28 of 30 draws of ours" in words[0]
    assert table.rows[4][5:7] == (pytest.approx(10.7, abs=0.3), pytest.approx(0.7, abs=0.15)), (
        "a draw alone: 11.61"
    )
    assert "twice the s.d. of a draw" in claims_of(crop)["decision"][1].within
    assert changes.rows[0][1:] == pytest.approx((1.25, 1.79, 3.68, 4.39), abs=0.01)
    # the published CV at 2 Hz is an input of the canopy
    assert table.rows[0][5] is None


def test_table_2_forward_from_the_ndvi_that_is_printed(crop: Crop) -> None:
    """FC: 0.546, 18.9 kg published. 0.359 exp(324.4 x 0.546 / 82) = 3.113 t/ha leaves 320.2
    kg/ha at the mean."""
    table, _ = compare_forward_targets(crop)
    assert table.rows[0] == (
        "FC",
        18.9,
        pytest.approx(19.21, abs=0.01),
        pytest.approx(18.80, abs=0.01),
        pytest.approx(17.02, abs=0.01),
        pytest.approx(18.95, abs=0.01),
    )
    verdicts = {
        claim.says.rpartition(": ")[2]: claim.agrees
        for claim in claims_of(crop)["decision"]
        if "from its NDVI" in claim.says
    }
    assert verdicts == {
        "smooth rate at the mean": False,
        "smooth rate over the canopy": True,
        "grades over the canopy": False,
        "one grade, of the mean": True,
    }


def test_the_point_papers_delays_and_shaft_speeds() -> None:
    obtained = {row[0]: row[2] for row in make_delay_table().rows}
    assert obtained["vision"] is None and obtained["link"] is None  # inputs
    assert all(
        row[1] == pytest.approx(row[2], abs=0.005)
        for row in make_delay_table().rows
        if row[2] is not None
    )
    assert all(row[1] == pytest.approx(row[2], rel=0.006) for row in make_microstep_table().rows)


def test_the_page_is_written_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from topdress.console.cli import reproduce
    from topdress.control.papers.lag_paper import make_lag_section

    monkeypatch.setattr(reproduce, "run_papers", lambda seed: [make_lag_section(Machine())])
    told = topdress("reproduce", "--out", tmp_path / "r")
    assert told.exit_code == 0, told.stderr
    page = (tmp_path / "r" / "reproduce.html").read_text()
    assert (
        page.count("<svg") == 4
        and "position at 1 Hz" in page
        and "http" not in page.replace("http-equiv", "")
    )
    assert len(list((tmp_path / "r").glob("*.csv"))) == 14
    anchors = set(re.findall(r'href="#([^"]+)"', page))
    assert anchors and all(page.count(f'id="{anchor}"') == 1 for anchor in anchors)


def claims_of(crop: Crop) -> dict[str, list[Claim]]:
    (table, _), _ = simulate_sampling(1)
    forward, _ = compare_forward_targets(crop)
    simulated = Table("", (), tuple((plot, *(0.0,) * 9) for plot in published.APPLIED_AMOUNTS), ())
    return {
        "decision": list_decision_claims(crop, table, forward, simulated),
        "lag": list_lag_claims(Machine()),
        "points": list_points_claims(calc_point_lag(120.0, 99.8, 1.0)),
    }


def test_every_equation_table_and_figure_has_a_row(crop: Crop) -> None:
    has = {"decision": (5, 3, 7), "lag": (6, 6, 10), "points": (5, 1, 5)}
    for paper, claims in claims_of(crop).items():
        where = " ".join(claim.where for claim in claims)
        where = where.replace("eq 4, 5", "eq 4 eq 5").replace(
            "figures 5 to 8", "figure 5 figure 6 figure 7 figure 8"
        )
        for word, count in zip(("eq", "table", "figure"), has[paper], strict=True):
            missing = [n for n in range(1, count + 1) if not re.search(rf"{word} {n}\b", where)]
            assert not missing, (paper, word, missing)


def test_nothing_is_obtained_for_a_copied_figure(crop: Crop) -> None:
    for claims in claims_of(crop).values():
        make_claim_table("paper", claims)
        assert all(claim.agrees is None for claim in claims if claim.how is ResultOrigin.COPIED)
    with pytest.raises(ValueError, match="table 9, a figure: obtained '3' is copied"):
        make_claim_table("paper", [Claim("table 9", "a figure", "3", "3", ResultOrigin.COPIED)])


def test_every_verdict_prints_its_tolerance_and_why(crop: Crop) -> None:
    for claims in claims_of(crop).values():
        for claim in claims:
            assert (claim.agrees is None) == (claim.within == ""), claim
            assert claim.agrees is None or re.fullmatch(
                r"(none|the sign|[\d.]+.*): .+", claim.within
            ), claim
    with pytest.raises(ValueError, match="agrees True, within ''"):
        make_claim_table(
            "paper", [Claim("table 9", "a figure", "3", "3", ResultOrigin.RECOMPUTED, True)]
        )


def test_what_the_machine_file_was_fitted_to_is_not_said_to_be_simulated(crop: Crop) -> None:
    how = {claim.where: claim.how for claim in list_lag_claims(Machine())}
    assert (
        how["table 2"] is ResultOrigin.FITTED
        and how["table 3"] is ResultOrigin.FITTED
        and how["table 1"] is ResultOrigin.SIMULATED
    )


def test_yields_follow_from_the_samples_as_far_as_these_are_rounded(crop: Crop) -> None:
    said = {
        claim.says.split()[2]: claim.agrees
        for claim in claims_of(crop)["decision"]
        if "from its sample" in claim.says
    }
    assert said == {"CK": False, "FA": True, "FB": True, "FC": False, "CP": True}


def test_field_times_of_table_4_were_made_at_4_5_km_h_and_its_detector_is_early(crop: Crop) -> None:
    said = {claim.says: claim for claim in list_lag_claims(Machine())}
    assert said["L = v T / 3.6: table 4's field times from table 1's distances"].obtained == (
        "4.500 km/h (4.499 to 4.501 in 10 of 10 rows)"
    )
    early = said["why the detector differs: it misses the first granules"]
    assert (
        early.agrees is False
        and early.obtained == "detected less field -0.31 s"
        and "10 of 10" in early.remark
    )


def test_the_field_lag_is_that_of_table_1_and_not_of_table_4() -> None:
    fits = {
        fit.reading.name: fit
        for fit in compare_interpretations(Machine(), published.CORRECTED_M, trials=50)
    }
    assert fits["field lag of table 1"].mean_m == pytest.approx(0.537, abs=0.001)


def test_printed_yields_do_not_follow_from_the_sample_weights() -> None:
    assert [row[4] for row in make_yield_table().rows] == pytest.approx(
        [6020.0, 6120.0, 6320.0, 7020.0, 7120.0]
    )
    assert make_yield_table().rows[0][7] == pytest.approx(2277.0, abs=1.0)


def test_eq_2_is_right_and_eq_5_halves_the_way() -> None:
    asked = []
    assert count_agreeing_cells(
        cell=lambda at, half: asked.append(at) or find_paper_cell(at, half)
    ) == (
        1001,
        1001,
    )
    assert asked == pytest.approx(np.linspace(0.0, 100.0, 1001))
    rows = make_boundary_table().rows
    assert rows[0][1:] == (pytest.approx(10.0, abs=0.01), pytest.approx(20.0, abs=0.01))
    assert rows[1][1] == 0.0 and rows[3][1] is None
    assert all(row[2] == pytest.approx(20.0, abs=0.01) for row in rows)
