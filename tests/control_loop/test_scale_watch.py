"""What no trim may hide: a scale that is wrong, an outlet that is blocked, a shaft that does
not turn as it reads."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, pi, radians, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
import pytest
from topdress.control.metering.flow_trim import FlowTrim
from topdress.control.readings import Reading, ScaleFinding

DT_S = 0.1
SCALE_KG = 0.15  # correlated over 1 s, in steps of 0.05 kg
STANDS_S, BEGINS_S = 20.0, 120.0


class Told(NamedTuple):
    # changes of what is said, by the time since `BEGINS_S`
    said: list[tuple[float, ScaleFinding]]
    trims: np.ndarray  # (n,) by tick
    filter: FlowTrim

    def first_s(self, is_said: Callable[[ScaleFinding], bool]) -> float:
        return next((at_s for at_s, says in self.said if is_said(says)), float("inf"))


def red(says: ScaleFinding) -> bool:
    return (
        says.share is not None
        or says.outlets > 0
        or says.beyond_percent is not None
        or says.unordered_kg > 0.0
    )


def runs(
    seconds: float,
    *,
    flow_kg_s: float = 0.09,
    leaves: Callable[[float, float], float] = lambda s, kg_s: kg_s,
    reads: Callable[[float, float], float] = lambda s, kg: kg,
    flows: Callable[[float], bool] = lambda s: True,
    seed: int = 1,
    orders: Callable[[float, FlowTrim], None] = lambda s, trim: None,
    pitch_deg: Callable[[float], float] = lambda s: 0.0,
    labours: Callable[[float], bool] = lambda s: False,
) -> Told:
    """Stand for 20 s, then work; times from `BEGINS_S` on. leaves: (time, ordered kg/s) to what
    truly leaves, kg/s. reads: (time, true kg) to what an ideal scale would read."""
    rng, keep = np.random.default_rng(seed), exp(-DT_S)
    trim, kg, noise, said, trims = FlowTrim(outlets=6, most_kg_s=0.55), 300.0, 0.0, [], []
    for k in range(round((seconds + BEGINS_S) / DT_S)):
        at_s, since_s = k * DT_S, k * DT_S - BEGINS_S
        ordered = (
            flow_kg_s * (1.0 + 0.15 * sin(at_s / 7.0))
            if at_s > STANDS_S and flows(since_s)
            else 0.0
        )
        model = ordered / trim.present_factor
        kg -= leaves(since_s, model) * DT_S
        noise = keep * noise + sqrt(1.0 - keep * keep) * SCALE_KG * float(rng.standard_normal())
        weighed = round((reads(since_s, kg) + noise) / 0.05) * 0.05
        rpm, pitch = 70.0 if model > 0.0 else 0.0, pitch_deg(since_s)
        trim.update_trim(at_s, DT_S, model, rpm, pitch, Reading(weighed, at_s), labours(since_s))
        orders(since_s, trim)
        if not said or trim.scale_finding._replace(trimmed_percent=0.0) != said[-1][1]._replace(
            trimmed_percent=0.0
        ):
            said.append((since_s, trim.scale_finding))
        trims.append(trim.present_factor)
    return Told(said, np.array(trims), trim)


def from_0(factor: float) -> Callable[[float, float], float]:
    return lambda s, kg_s: kg_s * (factor if s >= 0.0 else 1.0)


# --- A scale that is wrong moves the flow by 10 % at most, and not for long
# ------------------------------------------


@pytest.mark.parametrize("gain", [0.6, 0.7, 1.3])
def test_a_scale_whose_gain_is_wrong_is_said_and_trims_nothing(gain: float) -> None:
    """0.7: the ground got 31 % more, for ever, without a word."""
    run = runs(120.0, reads=lambda s, kg: gain * kg)
    assert run.first_s(lambda says: says.beyond_percent is not None) < -BEGINS_S + STANDS_S + 60.0
    assert run.trims[-1] == 1.0 and np.abs(run.trims - 1.0).max() <= 0.1
    beyond = run.filter.scale_finding.beyond_percent
    assert beyond is not None and beyond == pytest.approx(100.0 * (gain - 1.0), abs=4.0)


def test_the_estimate_itself_is_bounded() -> None:
    """Filled at 0.1 kg/s for 60 s: the state was at -79 %, and the trim at its limit for 75 s
    afterwards."""
    run = runs(120.0, reads=lambda s, kg: kg + 0.1 * min(60.0, max(0.0, s)))
    assert np.abs(run.trims - 1.0).max() < 0.02
    assert abs(run.filter._state[1]) < 12.0
    assert run.first_s(lambda says: says.off_kg != 0.0) < 15.0
    assert run.first_s(lambda says: says.share is not None) < 42.0


@pytest.mark.parametrize("period_s", [20.0, 30.0])
@pytest.mark.parametrize("from_start", [True, False])
def test_a_scale_that_sways_accuses_nobody_and_moves_little(
    period_s: float, from_start: bool
) -> None:
    for turn in np.linspace(0.0, 2.0 * pi, 4, endpoint=False):

        def sways(s: float, kg: float, turn: float = float(turn)) -> float:
            return kg + (
                sin(2.0 * pi * s / period_s + turn) - (0.0 if from_start else sin(turn))
                if from_start or s > 0.0
                else 0.0
            )

        run = runs(120.0, reads=sways, seed=int(10 * turn) + 1)
        assert run.first_s(red) == float("inf")
        assert np.abs(run.trims - 1.0).max() < 0.06


def test_a_refill_of_known_mass_finds_the_scales_gain() -> None:
    """120 kg filled in while it stands; the scale rises by 84."""

    def fills(s: float, trim: FlowTrim) -> None:
        if abs(s - 12.0) < 0.5 * DT_S:
            trim.record_refill(120.0)

    for gain, expected in ((0.7, -30.0), (1.0, None)):
        run = runs(
            60.0,
            flows=lambda s: not 0.0 < s < 20.0,
            orders=fills,
            reads=lambda s, kg, gain=gain: gain * (kg + (120.0 if s > 10.0 else 0.0)),
        )
        found = run.filter.scale_finding.refill_percent
        if expected is None:
            assert found is None
        else:
            assert found == pytest.approx(expected, abs=1.0) and run.trims[-1] == 1.0


def test_a_fresh_catch_test_is_believed_rather_than_the_scale() -> None:
    def trimmed(age_days: float | None) -> float:
        def tested(s: float, trim: FlowTrim) -> None:
            if age_days is not None and s < -BEGINS_S + 0.5 * DT_S:
                trim.set_catch_test_age(age_days)

        return float(runs(120.0, leaves=lambda s, kg_s: 1.06 * kg_s, orders=tested).trims[-1]) - 1.0

    none, old, fresh = trimmed(None), trimmed(400.0), trimmed(0.0)
    assert none == pytest.approx(old, abs=5e-4) and none > 0.045
    assert 0.02 < fresh < 0.8 * none


# --- What nothing decides: shaft against scale, an outlet
# ------------------------------------------------------------


@pytest.mark.parametrize(("factor", "by_s"), [(0.0, 40.0), (0.25, 42.0), (2.0, 40.0), (4.0, 32.0)])
def test_a_flow_far_from_what_the_shaft_reads_is_said(factor: float, by_s: float) -> None:
    for seed in range(3):
        run = runs(60.0, leaves=from_0(factor), seed=seed)
        assert run.first_s(lambda says: says.off_kg != 0.0) < 15.0
        assert 15.0 < run.first_s(lambda says: says.share is not None) < by_s
        assert run.trims[-1] == 1.0
        run.filter.begin_work()
        assert run.filter.scale_finding.share is None and run.filter.present_factor == 1.0, (
            "a new START spreads by the model"
        )


@pytest.mark.parametrize("outlets", [1, 2])
def test_an_outlet_that_closes_is_said_and_not_made_up_for(outlets: int) -> None:
    """The drive works harder from 4 s on: its effort and the scale are two witnesses."""
    for seed in range(3):
        leaves = from_0(1.0 - outlets / 6.0)
        run = runs(120.0, leaves=leaves, seed=seed, labours=lambda s: s > 4.0)
        assert run.first_s(lambda says: says.outlets > 0) < 45.0
        assert (
            run.filter.scale_finding.outlets == outlets and run.filter.scale_finding.of_outlets == 6
        )
        assert abs(run.trims[-1] - 1.0) < 0.02


@pytest.mark.parametrize("labours", [False, True])
@pytest.mark.parametrize("factor", [0.8, 0.85, 5.0 / 6.0])
def test_a_fall_that_no_effort_bears_out_is_no_blocked_outlet(factor: float, labours: bool) -> None:
    """Another lot, or a gate or shaft that reads wrong; also where the drive has worked harder
    all along (cold grease)."""
    run = runs(120.0, leaves=from_0(factor), labours=lambda s: labours)
    assert run.first_s(lambda says: says.outlets > 0) == float("inf")
    assert run.first_s(lambda says: says.below_percent is not None) < 80.0
    assert run.filter.scale_finding.below_percent == pytest.approx(100.0 * (1.0 - factor), abs=4.0)
    assert run.filter.scale_finding.beyond_percent is None and abs(run.trims[-1] - 1.0) < 0.03


def test_a_drive_that_works_harder_while_all_flows_accuses_no_outlet() -> None:
    run = runs(120.0, labours=lambda s: s > 4.0)
    assert run.first_s(red) == float("inf") and run.filter.scale_finding.below_percent is None


def test_a_flow_that_changes_by_six_per_cent_is_trimmed_all_the_same() -> None:
    run = runs(240.0, leaves=from_0(1.06))
    assert run.first_s(red) == float("inf") and run.trims[-1] > 1.048


# --- A scale on slopes: what pitch does to it is no flow
# ------------------------------------------------------------------------------------

PASS_S, TURN_S = 60.0, 12.0  # up and down a slope by turns, without flow in the turns


def passes(slope_deg: float) -> Callable[[float], float]:
    """Pitch by the time: up, a turn, down, a turn."""

    def pitch_deg(s: float) -> float:
        legs, into_s = divmod(s, PASS_S + TURN_S)
        turned = max(0.0, into_s - PASS_S) / TURN_S
        return slope_deg * (1.0 if legs % 2 == 0 else -1.0) * cos(pi * turned)

    return pitch_deg


def on_slope(slope_deg: float, tilt_percent_per_deg: float, cosine_share: float) -> dict[str, Any]:
    """What `runs` needs of a machine there; the scale's own tilt in % a degree."""
    pitch_deg = passes(slope_deg)

    def reads(s: float, kg: float) -> float:
        pitch = pitch_deg(s)
        upright = 1.0 - cosine_share * (1.0 - cos(radians(pitch)))
        return kg * upright * (1.0 + 0.01 * tilt_percent_per_deg * pitch)

    return {
        "pitch_deg": pitch_deg,
        "flows": lambda s: s % (PASS_S + TURN_S) < PASS_S,
        "reads": reads,
    }


@pytest.mark.parametrize(
    ("slope_deg", "tilt_percent_per_deg", "cosine_share"),
    [(4.0, 0.05, 0.0), (8.0, 0.3, 1.0), (8.0, 0.0, 1.0), (8.0, -0.3, 0.0)],
)
def test_a_scale_that_reads_with_the_slope_accuses_nobody(
    slope_deg: float, tilt_percent_per_deg: float, cosine_share: float
) -> None:
    """4 degrees and 0.05 % stopped the machine in its first turn: `flow_unordered`."""
    run = runs(500.0, seed=3, **on_slope(slope_deg, tilt_percent_per_deg, cosine_share))
    assert [says for _, says in run.said if red(says) or says.off_kg != 0.0] == []
    assert np.abs(run.trims - 1.0).max() < 0.03


def test_on_a_slope_a_leak_in_the_turns_is_said_once_the_tilt_is_known() -> None:
    """500 kg/h, on a scale that reads 0.1 % more with each degree."""
    slope = on_slope(4.0, 0.1, 1.0)
    run = runs(
        400.0,
        leaves=lambda s, kg_s: kg_s if slope["flows"](s) or s < 250.0 else 0.139,
        **slope,
    )
    assert 250.0 < run.first_s(lambda says: says.unordered_kg > 0.0) < 400.0


# --- Material that nobody ordered
# ------------------------------------------------------------------------------------


@pytest.mark.parametrize("from_work", [True, False])
def test_a_fall_of_the_scale_while_nothing_turns_is_said_and_counted(from_work: bool) -> None:
    counted: list[float] = []
    for seed in range(3):
        counted.clear()
        run = runs(
            60.0,
            leaves=lambda s, kg_s: 0.16 if 0.0 < s < 30.0 else kg_s,
            seed=seed,
            flows=lambda s: from_work and s < -10.0,
            orders=lambda s, trim: counted.append(trim.take_unordered_kg()),
        )
        assert run.first_s(lambda says: says.unordered_kg > 0.0) < 10.0
        assert sum(counted) == pytest.approx(4.8, abs=0.5)
        assert run.filter.scale_finding.unordered_kg == 0.0, "it has ended"


@pytest.mark.parametrize(
    "reads",
    [
        lambda s, kg: kg + 0.1 * min(60.0, max(0.0, s)),
        lambda s, kg: kg + (80.0 if 0.0 < s < 20.0 else 0.0),
        lambda s, kg: kg + sin(2.0 * pi * s / 30.0),
    ],
    ids=["filled slowly", "a man on the hopper", "sways"],
)
def test_what_else_a_scale_does_while_it_stands_is_no_flow(
    reads: Callable[[float, float], float],
) -> None:
    for seed in range(4):
        run = runs(100.0, flows=lambda s: s > 80.0, reads=reads, seed=seed)
        assert run.first_s(red) == float("inf") and np.abs(run.trims - 1.0).max() < 0.03


@pytest.mark.parametrize("flow_kg_s", [0.02, 0.15])
@pytest.mark.exam
def test_a_sound_machine_is_accused_of_nothing_in_an_hour(flow_kg_s: float) -> None:
    run = runs(
        3600.0,
        flow_kg_s=flow_kg_s,
        flows=lambda s: s % 100.0 < 88.0,
        seed=int(1000 * flow_kg_s),
        reads=lambda s, kg: kg + 1000.0,
    )
    assert [says for _, says in run.said if red(says) or says.off_kg != 0.0] == []


# --- Wind and people: a load that returns to its mean is no flow
# ------------------------------------------------------------------------------------


def in_gusts(seed: int, from_s: float = -BEGINS_S) -> Callable[[float, float], float]:
    """A scale in gusts of 2 kg (3 s.d.) that last for 8 s."""
    rng, gust, keep = np.random.default_rng(100 + seed), [0.0], exp(-DT_S / 8.0)

    def reads(s: float, kg: float) -> float:
        fresh = 2.0 / 3.0 * sqrt(1.0 - keep * keep) * float(rng.standard_normal())
        gust[0] = keep * gust[0] + fresh
        return kg + (gust[0] if s >= from_s else 0.0)

    return reads


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_wind_on_the_hopper_accuses_nobody_at_work_or_in_a_stop(seed: int) -> None:
    run = runs(240.0, reads=in_gusts(seed), seed=seed, flows=lambda s: s % 80.0 < 50.0)
    assert run.first_s(red) == float("inf")
    assert np.abs(run.trims - 1.0).max() < 0.03


def test_in_wind_a_person_who_steps_up_and_down_accuses_nobody() -> None:
    reads = in_gusts(5)
    run = runs(
        200.0,
        reads=lambda s, kg: reads(s, kg) + (80.0 if s % 100.0 > 60.0 and s % 20.0 < 12.0 else 0.0),
        seed=5,
        flows=lambda s: s % 100.0 < 60.0,
    )
    assert run.first_s(red) == float("inf")
    assert np.abs(run.trims - 1.0).max() < 0.05


def test_in_wind_a_leak_and_an_empty_flow_are_said_all_the_same() -> None:
    """Later: a leak grows, a gust goes back."""
    leak = runs(
        100.0,
        leaves=lambda s, kg_s: 0.14 if s > 0.0 else kg_s,
        reads=in_gusts(6),
        flows=lambda s: s < -10.0,
    )
    assert 0.0 < leak.first_s(lambda says: says.unordered_kg > 0.0) < 60.0
    bridge = runs(120.0, leaves=from_0(0.0), reads=in_gusts(7))
    assert 0.0 < bridge.first_s(lambda says: says.share is not None) < 110.0


def test_a_scale_that_is_said_to_have_no_noise_is_used() -> None:
    """The machine file allows noise 0: a division by it ended the control."""
    trim = FlowTrim(0.0)
    for k in range(600):
        trim.update_trim(k * DT_S, DT_S, 0.0, 0.0, 0.0, Reading(300.0, k * DT_S))
    assert trim.scale_finding.unordered_kg == 0.0
