"""Effects planted in bench tables by formulas of the tests' own: a diagnosis must find them,
and nothing in noise."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from topdress.control.calibration.bench_table import BenchTable
from topdress.control.calibration.lag_fit import fit_lag
from topdress.control.diagnosis.result import Diagnosis
from topdress.control.diagnosis.tables import diagnose_tables
from topdress.control.diagnosis.tables.cross_calibration import compare_lag_series
from topdress.control.diagnosis.tables.problem import make_problem
from topdress.control.diagnosis.tables.search import search_table_models
from topdress.control.diagnosis.tables.table_rows import make_table_pieces
from topdress.control.diagnosis.tables.verdict import judge_table_search
from topdress.control.machine.fall import calc_drop_s, find_start_drop_s
from topdress.control.machine.machine import CATALOGUE
from topdress.control.machine.start_lag import calc_response_s
from topdress.drivers.files.bench_table import read_bench_table

from tests.diagnosis.planted import Between, answered_wrongly, check, members
from tests.diagnosis.tables import (
    MACHINE,
    SEVENS,
    Array,
    Rng,
    catch_grid,
    catches,
    crossed,
    diagnosed,
    heads,
    labelled_lags,
    lags,
    misses,
    place_grid,
    responses,
    total_s,
    weighs,
)

approx = pytest.approx
Tables = Callable[[Rng], BenchTable | list[BenchTable]]


def rng_of(seed: int) -> Rng:
    return np.random.default_rng(seed)


def steady(*args: Array) -> Array:
    return np.ones_like(args[0])


def upward(rpm: Array) -> Array:
    return 0.4 * (np.maximum(0.0, rpm - 65) / 35) ** 1.4


def ids(found: Diagnosis) -> set[str]:
    return {cause.id for cause in found.causes}


# --- Nothing in noise, one effect, and how often
# ---------------------------------------------------------------------

NULLS: dict[str, Callable[[Rng], BenchTable]] = {
    "lag": lambda rng: lags(np.tile(SEVENS, 3), rng),
    "catch": lambda rng: catch_grid(rng, steady),
    "weigh": weighs,
    "heads": lambda rng: heads(rng, lambda ndvi, head, minute: ndvi, heads=3),
    "place": place_grid,
}


def risen(rng: Rng, speeds: Array, repeats: int) -> BenchTable:
    rpm = np.tile(speeds, repeats)
    return lags(rpm, rng, upward(rpm))


def waves(rng: Rng) -> BenchTable:
    rpm = np.linspace(10.0, 70.0, 40)
    return lags(rpm, rng, 0.1 * np.sin(rpm / 2.2))


def settings_off_at_random(rng: Rng) -> BenchTable:
    off_s = np.repeat(0.08 * rng.standard_normal(25), 4)
    return lags(np.repeat(np.linspace(10.0, 70.0, 25), 4), rng, off_s)


RPM = np.tile([30.0, 40.0, 50.0, 60.0, 70.0], 8)
BEFORE = np.repeat([20.0, 25.0], 20)
DEAD_S = MACHINE.shaft.dead_time_s
RUNNING_S = DEAD_S + np.array([calc_drop_s(MACHINE.fall, n) for n in RPM.tolist()])
START_S = np.array(
    [calc_response_s(MACHINE, n) + find_start_drop_s(MACHINE.fall, n) for n in RPM.tolist()]
)
STANDS = np.arange(len(RPM)) % 2 == 0
ASKED_FROM = np.where(STANDS, 5.0, 90.0)


def shaken(rng: Rng) -> Array:
    return 0.01 * rng.standard_normal(len(RPM))


def timed(lag_s: Array, before: Array | None = BEFORE) -> BenchTable:
    columns = {"shaft_rpm": RPM, "lag_s": lag_s}
    return BenchTable(
        "lag", columns if before is None else {**columns, "before_rpm": before}, path="lags.csv"
    )


def often(
    name: str, seeds: range, least: int, make: Tables, exam: bool = False, **said: Any
) -> Any:
    """Of the tables that the seeds make so many at least are answered so."""
    return pytest.param(seeds, least, make, said, id=name, marks=[pytest.mark.exam] * exam)


def single(name: str, effect: str, size: float, tolerance: float, make: Tables, **said: Any) -> Any:
    return often(
        f"one effect: {name}",
        range(100, 105),
        4,
        make,
        verdict="named",
        names=[effect],
        in_interval=True,
        sizes={effect: approx(size, abs=tolerance)},
        **said,
    )


# Three tables of noise, and 150 that are held to the chance of 2 %.
@pytest.mark.exam
@pytest.mark.parametrize(
    ("seeds", "least", "make", "said"),
    [
        *(
            often(f"nothing in {kind}", range(3), 3, make, verdict="none")
            for kind, make in NULLS.items()
        ),
        *(
            often(f"nothing in 150 of {kind}", range(150), 147, make, True, verdict="none")
            for kind, make in NULLS.items()
        ),
        often(
            "smooth times without replicates, by their order",
            range(120),
            117,
            lambda r: lags(np.linspace(10.0, 70.0, 40), r),
            True,
            verdict="none",
        ),
        single(
            "rebound",
            "lag.rebound",
            0.4,
            0.15,
            lambda r: risen(r, np.array([10.0, 30, 50, 70, 80, 90, 100]), 3),
        ),
        single(
            "clock",
            "lag.coarse_clock",
            0.12,
            0.005,
            lambda r: lags(np.tile(SEVENS, 6), r, sd=0.08, step_s=0.12),
        ),
        single(
            "gain",
            "flow.gain",
            7.0,
            1.0,
            lambda r: catch_grid(r, lambda n, o: 1.07 * np.ones_like(n)),
        ),
        single(
            "offset",
            "flow.zero_offset",
            4.0,
            1.0,
            lambda r: catch_grid(r, lambda n, o: 1.0 + 4.0 / (5.5 * o)),
        ),
        single(
            "falloff",
            "flow.fill_falloff",
            9.0,
            2.5,
            lambda r: catch_grid(r, lambda n, o: 1.0 - 0.09 * (n / 100) ** 2.5),
        ),
        single(
            "uneven",
            "flow.outlet_uneven",
            6.0,
            1.5,
            lambda r: catch_grid(r, lambda n, k: np.where(k == 4, 1.06, 1.0), outlets=True),
            member=4,
        ),
        single(
            "fouled",
            "canopy.head_fouled",
            -8.0,
            2.0,
            lambda r: heads(r, lambda v, k, t: v * np.where(k == 5, 0.92, 1.0)),
            member=5,
        ),
        single(
            "warm",
            "canopy.warm_up",
            7.0,
            2.5,
            lambda r: heads(r, lambda v, k, t: v * (1 + 0.07 / (1.0 + (t / 9.0) ** 1.5))),
        ),
        single(
            "saturation",
            "canopy.saturation",
            10.0,
            3.0,
            lambda r: heads(r, lambda v, k, t: v * (1 - 0.10 * (v / 0.8) ** 4), timed=False),
        ),
        single("arm", "place.lever_arm", 0.35, 0.12, lambda r: place_grid(r, arm_m=0.35)),
        single("late", "place.latency", 0.30, 0.12, lambda r: place_grid(r, late_s=0.30)),
        often(
            "another shape of an effect calls in no second cause",
            range(2),
            2,
            lambda r: catch_grid(
                r,
                lambda n, o: 1 - 0.15 * np.maximum(0.0, (n - 40) / 60),
                speeds=(15, 30, 50, 70, 85, 100),
            ),
            verdict="named",
            names=["flow.fill_falloff"],
        ),
        often(
            "warming up, sized at power-on whatever its time constant",
            range(4),
            2,
            lambda r: heads(r, lambda v, k, t: v * (1 + 0.12 * np.exp(-t / 4.0))),
            covers={"canopy.warm_up": 12.0},
        ),
        often(
            "a weigh table names the whole set",
            range(2),
            2,
            lambda r: weighs(r, factor=1.08),
            verdict="ambiguous",
            among={"flow.gain", "speed.wheel_slip", "speed.wheel_radius", "scale.gain"},
            next_run="static weigh",
            all_said=Between(0.0, 1.0 + 1e-6),
        ),
        *(
            often(
                f"no smooth curve: {make.__name__}",
                range(2),
                2,
                make,
                verdict="unexplained",
                names=[],
                left=[("lag", ""), ("lag", "shaft_rpm")],
                share_left=Between(0.2, 1.0 + 1e-12),
                structure_p=Between(high=0.05),
            )
            for make in (waves, settings_off_at_random)
        ),
        often(
            "a running shaft of a nominal machine",
            range(2),
            2,
            lambda r: timed(RUNNING_S + shaken(r)),
            verdict="none",
        ),
        often(
            "a running shaft taken for starts is too short",
            range(2),
            2,
            lambda r: timed(RUNNING_S + shaken(r), None),
            verdict=("named", "ambiguous", "unexplained"),
        ),
    ],
)
def test_so_many_are_answered_so(
    seeds: range, least: int, make: Callable[[Rng], BenchTable], said: Mapping[str, Any]
) -> None:
    wrong = [answered_wrongly(diagnosed(make(rng_of(seed))), said) for seed in seeds]
    assert sum(not one for one in wrong) >= least, wrong


@pytest.mark.exam
def test_intervals_cover_the_hidden_size() -> None:
    inside = 0
    for seed in range(80):
        rng = rng_of(seed)
        off = 1.0 + 0.001 * rng.standard_normal()  # the machine file's own tolerance
        cause = diagnosed(
            catch_grid(rng, lambda n, o, off=off: 1.05 * off * np.ones_like(n))
        ).causes[0]
        assert cause.id == "flow.gain"
        inside += cause.size.low <= 5.0 <= cause.size.high
    assert 0.82 * 80 <= inside <= 0.98 * 80


# --- One table, and what is said of it
# -------------------------------------------------------------------------------


def labelled(
    rng: Rng,
    column: str,
    words: tuple[str, str],
    later_s: tuple[float, float],
    sd: float = 0.03,
    digits: int | None = None,
) -> BenchTable:
    """Half of the rows carry one word, the others the other one; each half is later by its own."""
    label = np.repeat(words, 12)
    return lags(
        np.tile([20.0, 40, 60], 8),
        rng,
        np.where(label == words[0], *later_s),
        sd,
        digits=digits,
        label_column=column,
        label=label,
    )


def of_one_label(rng: Rng) -> BenchTable:
    label = np.repeat(["rig", "field"], 21)
    return lags(
        np.tile(SEVENS, 6),
        rng,
        0.0,
        0.02,
        factor=np.where(label == "field", 1.2, 1.0),
        digits=None,
        label_column="source",
        path="both.csv",
        label=label,
    )


def distances_and_times(rng: Rng) -> BenchTable:
    rpm = np.tile([10.0, 30, 50, 70], 4)
    return BenchTable(
        "lag",
        {
            "shaft_rpm": rpm,
            "speed_kmh": np.full(16, 4.3),
            "lag_s": total_s(rpm) + 0.03 * rng.standard_normal(16),
            "lag_m": (total_s(rpm) + 0.03 * rng.standard_normal(16)) * 4.3 / 3.6 * 1.12,
        },
    )


def far_row(rng: Rng) -> BenchTable:
    table = lags(np.tile(SEVENS, 6), rng)
    table.columns["lag_s"][4] += 3.0
    return table


def misses_at_one_speed(rng: Rng) -> BenchTable:
    rpm = np.tile([30.0, 60.0], 8)
    return misses(
        rpm,
        1.3,
        1.3 * (total_s(rpm) + 0.5) + 0.1 * rng.standard_normal(16),
        corrected_lag_s=np.zeros(16),
    )


def replicates_that_drift(rng: Rng) -> BenchTable:
    rpm, speed, again = crossed([30.0, 60.0], [1.3], np.arange(1.0, 9.0))
    return misses(
        rpm, speed, 0.25 * (again - 4.5) + 0.08 * rng.standard_normal(len(rpm)), replicate=again
    )


def lag_of(path: str, later_s: float, seed: int) -> BenchTable:
    return lags(np.tile(SEVENS, 3), rng_of(seed), later_s, path=path)


def before_and_after(rng: Rng, after_m: float) -> list[BenchTable]:
    rpm = np.tile(SEVENS, 3)
    before = 1.25 * total_s(rpm) + 0.5 + 0.1 * rng.standard_normal(21)
    return [
        misses(rpm, 1.25, before, "before.csv", corrected_lag_s=np.zeros(21)),
        misses(rpm, 1.25, after_m + 0.1 * rng.standard_normal(21), "after.csv"),
    ]


def answered(rng: Rng, response_s: float) -> BenchTable:
    table = responses(np.tile(SEVENS, 4), rng, response_s, 0.01)
    return BenchTable(
        "lag", {**table.columns, "response_s": np.round(table.columns["response_s"], 3)}
    )


def one_setting_off(rng: Rng) -> BenchTable:
    rpm = np.tile(np.append(SEVENS, 100.0), 6)
    return lags(rpm, rng, 0.4 * (rpm == 100.0))


def one_panel(rng: Rng) -> BenchTable:
    head = np.repeat(np.arange(1.0, 7.0), 4)
    ndvi = 0.6 * np.where(head == 5, 0.9, 1.0) + 0.008 * rng.standard_normal(24)
    return BenchTable(
        "heads", {"head": head, "ndvi_reference": np.full(24, 0.6), "ndvi": np.round(ndvi, 4)}
    )


FAR_TOO_LATE = lags(np.tile(SEVENS, 3), rng_of(1), 4.0, path="lag.csv")
OUTSIDE = "nearest effect: {}, but its size would have to lie outside"
RISES = np.tile(np.arange(10.0, 101.0, 10.0), 6)
TIMES = {"lag.offset", "shaft.dead_time"}
PLACES = {"place.lever_arm", "place.latency"}


def case(name: str, seed: int, tables: Tables, **said: Any) -> Any:
    return pytest.param(seed, tables, said, id=name)


@pytest.mark.parametrize(
    ("seed", "tables", "said"),
    [
        case(
            "two effects",
            3,
            lambda r: catch_grid(r, lambda n, o: 1.06 * (1 - 0.1 * (n / 100) ** 3)),
            names={"flow.gain", "flow.fill_falloff"},
        ),
        case(
            "a start from an empty tube",
            8,
            lambda r: labelled(r, "start", ("empty", "running"), (0.4, 0.0)),
            names={"lag.first_fill"},
            sizes={"lag.first_fill": approx(0.4, abs=0.08)},
        ),
        case(
            "a direction",
            8,
            lambda r: labelled(r, "direction", ("down", "up"), (0.2, -0.2)),
            names={"lag.asymmetry"},
            sizes={"lag.asymmetry": approx(0.4, abs=0.08)},
        ),
        *(
            case(
                f"an asymmetry all on one side, {down_s:+g} s",
                8,
                lambda r, down_s=down_s: labelled(
                    r, "direction", ("up", "down"), (0.0, down_s), 0.02, 3
                ),
                verdict="named",
                names={"lag.asymmetry"},
            )
            for down_s in (-0.25, 0.25)
        ),
        case(
            "one ground speed cannot tell a lever arm from a latency",
            2,
            lambda r: place_grid(r, arm_m=0.5, speeds=(1.2,)),
            verdict="ambiguous",
            among=PLACES,
            next_run="two measured ground speeds",
        ),
        case(
            "distances against times show the speed",
            4,
            distances_and_times,
            names={"lag.speed_scale"},
            covers={"lag.speed_scale": 12.0},
        ),
        case(
            "an effect of one label only",
            5,
            of_one_label,
            among={"lag.speed_scale"},
            says=("both.csv field only", "differs from"),
        ),
        case(
            "what no effect explains",
            6,
            lambda r: catch_grid(r, lambda n, o: 1.0 + 0.05 * np.cos(n / 9.0)),
            verdict="unexplained",
            first_left={"variable": "shaft_rpm"},
        ),
        case(
            "far rows do not carry a verdict",
            9,
            far_row,
            verdict="none",
            says="far from their replicates",
        ),
        # No effect has a dead time of minus so much.
        case(
            "earlier than nominal", 5, lambda r: answered(r, 0.303), verdict="unexplained", names=[]
        ),
        case(
            "later than nominal",
            5,
            lambda r: [answered(r, 0.303), answered(r, 0.463)][1:],
            names={"shaft.dead_time"},
        ),
        case(
            "misses at one speed are no wrong speed",
            6,
            misses_at_one_speed,
            verdict="ambiguous",
            no_other_than=PLACES,
        ),
        case(
            "replicates that drift",
            7,
            replicates_that_drift,
            verdict="unexplained",
            first_left={"variable": "replicate"},
        ),
        case(
            "what the field alone has",
            0,
            lambda r: [lag_of("rig.csv", 0.0, 1), lag_of("field.csv", 0.3, 2)],
            among=TIMES,
            says="holds in the rows of field.csv only",
        ),
        case(
            "what both have",
            0,
            lambda r: [lag_of("rig.csv", 0.3, 1), lag_of("field.csv", 0.3, 2)],
            among=TIMES,
            never_says="holds in the rows of field.csv only",
        ),
        case(
            "what a correction took away",
            4,
            lambda r: before_and_after(r, 0.0),
            no_other_than=PLACES,
            says="holds in the rows of before.csv only",
        ),
        case(
            "what a correction left",
            4,
            lambda r: before_and_after(r, 0.5),
            no_other_than=PLACES,
            never_says="holds in the rows of before.csv only",
        ),
        case(
            "where an effect holds is a field of its cause",
            3,
            lambda r: labelled_lags(0.0, 0.3),
            scope="two.csv blue",
        ),
        case("an effect of all rows has no scope", 3, lambda r: labelled_lags(0.3), scope=None),
        case(
            "one row is not judged",
            1,
            lambda r: catches(r, lambda n, o: 2.0, np.array([40.0]), np.array([20.0])),
            verdict="not_judged",
            names=[],
            says="catch.csv mass_kg: not judged",
        ),
        case(
            "a size far out of its bounds is a hint and no name",
            1,
            lambda r: catches(
                r, lambda n, o: 2.5, np.tile([20.0, 50.0, 80.0], 6), np.repeat([10.0, 30.0], 9)
            ),
            verdict="unexplained",
            names=[],
            structure_p=Between(high=0.001),
            says=OUTSIDE.format("flow.gain"),
        ),
        case(
            "a lag far out of its bounds is a hint and no name",
            1,
            lambda r: FAR_TOO_LATE,
            verdict="unexplained",
            names=[],
            structure_p=Between(high=0.001),
            says_one_of=[OUTSIDE.format(one) for one in sorted(TIMES)],
        ),
        case(
            "gain is measured on settings left out",
            10,
            lambda r: catch_grid(r, lambda n, o: 1.08 * np.ones_like(n)),
            gain=Between(high=0.2),
            gain_in_interval=True,
        ),
        case(
            "the one setting that shows it is the one left out",
            10,
            lambda r: risen(r, np.append(SEVENS, 100.0), 6),
            names=["lag.rebound"],
            gain=Between(0.95),
        ),
        case(
            "one setting that is off may have been set wrongly as well",
            10,
            one_setting_off,
            names=["lag.rebound"],
            says="something that no effect describes",
            probability=Between(high=0.99),
            gain=Between(0.9),
        ),
        case(
            "a rise over several settings",
            10,
            lambda r: lags(RISES, r, 0.4 * (np.maximum(0.0, RISES - 70.0) / 30.0)),
            verdict="named",
            gain=Between(high=0.8),
        ),
        # One setting is all that can show a member's effect: that is no reason to suspect it.
        case(
            "a head read over one panel is named by rows held out",
            3,
            one_panel,
            verdict="named",
            names=["canopy.head_fouled"],
            member=5,
            gain=Between(high=0.6),
            held_out="4 rows",
        ),
        case(
            "misses of a running shaft",
            3,
            lambda r: BenchTable(
                "place",
                {
                    "shaft_rpm": RPM,
                    "before_rpm": BEFORE,
                    "speed_mps": np.full(len(RPM), 1.2),
                    "corrected_lag_s": np.zeros(len(RPM)),
                    "miss_m": 1.2 * RUNNING_S + shaken(r),
                },
            ),
            verdict="none",
        ),
        case(
            "starts along with a running shaft",
            4,
            lambda r: timed(
                np.where(STANDS, START_S + 0.3, RUNNING_S) + shaken(r),
                np.where(STANDS, 0.0, BEFORE),
            ),
            names=["lag.first_fill"],
            covers={"lag.first_fill": 0.3},
        ),
        case(
            "rises and falls of a running shaft",
            5,
            lambda r: timed(
                RUNNING_S - 0.5 * 0.4 * np.sign(RPM - ASKED_FROM) + shaken(r), ASKED_FROM
            ),
            names=["lag.asymmetry"],
            covers={"lag.asymmetry": 0.4},
        ),
        # An offset of 80 g/rev is beyond the catalogue; at two openings next to each other it
        # looks like a gain.
        case(
            "a size out of its bounds is not named by two others",
            1,
            lambda r: catches(
                r,
                lambda n, o: 1.0 + 80.0 / (5.5 * o),
                np.tile([20.0, 50.0, 80.0, 100.0], 4),
                np.repeat([20.0, 22.0], 8),
            ),
            verdict="unexplained",
            names=[],
            says="nearest effect: flow.zero_offset",
        ),
    ],
)
def test_what_is_planted_is_said(seed: int, tables: Tables, said: Mapping[str, Any]) -> None:
    made = tables(rng_of(seed))
    found = diagnosed(*made) if isinstance(made, list) else diagnosed(made)
    check(found, **said)


def test_what_a_refused_name_showed_is_not_forgotten() -> None:
    found = judge_table_search(
        search_table_models(make_problem(make_table_pieces(FAR_TOO_LATE, MACHINE), MACHINE)), True
    )
    assert not found.named and found.nearest is not None and found.nothing < 1e-6


def test_a_column_without_a_number_is_named_first() -> None:
    table = lags(np.tile([10.0, 30.0, 50.0, 70.0], 5), rng_of(1))
    found = diagnosed(
        BenchTable("lag", {**table.columns, "response_s": np.full(20, np.nan)}, "", "lag.csv")
    )
    assert found.findings[0] == "lag.csv response_s: not judged: no row has a number"
    assert [channel.channel for channel in found.channels] == ["lag"]


def test_a_constant_extra_lag_and_a_late_shaft_are_told_apart_by_a_response_test_only() -> None:
    rng = rng_of(1)
    late = lags(np.tile(SEVENS, 3), rng, 0.25)
    check(diagnosed(late), verdict="ambiguous", no_other_than=TIMES, next_run="response test")
    both = diagnosed(late, responses(np.repeat([10.0, 40, 70], 4), rng, 0.383, 0.004, "response"))
    check(both, names=["lag.offset"])
    assert both.causes[0].probability > 0.6
    assert (
        sum(rival.probability for rival in both.causes[0].rivals if rival.id == "shaft.dead_time")
        < 0.1
    )


@pytest.mark.exam
def test_what_was_not_shown_has_a_size_or_none() -> None:
    found = diagnosed(catch_grid(rng_of(7), steady))
    smallest = {one.id: one.smallest_detectable.value for one in found.not_shown}
    assert smallest["flow.pulsation"] is None  # a half-minute catch evens the flutes out
    assert smallest["scale.gain"] is None
    limit = smallest["flow.gain"]
    assert limit is not None and 0.1 < limit < 3.0
    seen = sum(
        "flow.gain"
        in members(
            diagnosed(catch_grid(rng_of(seed), lambda n, o: (1 + limit / 100) * np.ones_like(n)))
        )
        for seed in range(20)
    )
    assert seen >= 15


def test_the_same_seed_gives_the_same_diagnosis_and_progress_can_cancel() -> None:
    class Cancelled(Exception):
        pass

    def stop(share: float, what: str) -> None:
        raise Cancelled

    table = risen(rng_of(11), SEVENS, 3)
    assert diagnose_tables([table], MACHINE, seed=5) == diagnose_tables([table], MACHINE, seed=5)
    with pytest.raises(Cancelled):
        diagnose_tables([table], MACHINE, progress=stop)


def test_json_has_every_field_of_the_contract() -> None:
    table = weighs(rng_of(1), factor=1.1, plots=20, targets=(10.0, 20.0, 40.0))
    found = json.loads(json.dumps(diagnosed(table).to_json(), allow_nan=False))
    assert found["format"] == "topdress-diagnosis/1" and found["data"]["kind"] == "weigh"
    assert found["causes"][0]["field_cost"]["rate_error_percent"] == approx(10.0, abs=3.0)
    assert len(found["not_shown"]) + len(
        {c["id"] for c in found["causes"]} | {r["id"] for c in found["causes"] for r in c["rivals"]}
    ) == len(CATALOGUE)
    assert diagnosed(labelled_lags(0.0, 0.3)).to_json()["causes"][0]["scope"] == "two.csv blue"


# --- Rows of a shaft that turned before: the settled drop of a running shaft, not the line of
# starts -----------------


def test_a_running_shaft_is_predicted_with_its_settled_drop() -> None:
    (piece,) = make_table_pieces(timed(RUNNING_S), MACHINE)
    assert piece.predict(MACHINE) == approx(RUNNING_S)
    # 0 or not known: it stood
    standing = np.where(BEFORE > 20.0, BEFORE, np.where(RPM > 40.0, 0.0, np.nan))
    (piece,) = make_table_pieces(timed(RUNNING_S, standing), MACHINE)
    assert piece.predict(MACHINE) == approx(np.where(BEFORE > 20.0, RUNNING_S, START_S))


def test_the_line_of_starts_leaves_a_running_shaft_out() -> None:
    times = np.where(STANDS, START_S, RUNNING_S)
    _, line = fit_lag(timed(times, np.where(STANDS, 0.0, BEFORE)), MACHINE)
    assert line.slope_s_per_rpm.value == approx(-0.0083, abs=1e-4)
    assert any("20 rows of a shaft that turned before are not used" in note for note in line.notes)
    with pytest.raises(ValueError, match="0 different shaft speeds"):
        fit_lag(timed(times), MACHINE)
    assert (
        compare_lag_series(
            [timed(times), BenchTable("lag", {"shaft_rpm": RPM, "lag_s": times}, path="b")], MACHINE
        )
        == ()
    )


def test_a_file_may_carry_the_speed_before(tmp_path: Any) -> None:
    path = tmp_path / "lags.csv"
    path.write_text("before_rpm,shaft_rpm,lag_s\n20,50,1.8\n,50,1.85\n0,60,1.7\n")
    assert read_bench_table(path).find_running_rows().tolist() == [True, False, False]
    path.write_text("before_rpm,shaft_rpm,lag_s\n20,50,1.8\n-3,50,1.85\n")
    with pytest.raises(ValueError, match="column before_rpm: -3: allowed 0 to 1000"):
        read_bench_table(path)
