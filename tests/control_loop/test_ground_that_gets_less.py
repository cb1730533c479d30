"""Margins along chosen edges, zones of the rule, a ceiling of the year: what the ground got, in
the closed loop."""

from __future__ import annotations

import datetime as dt
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from topdress.control.field.boundary import Boundary
from topdress.control.field.job import Ground, Job, Margin, Nitrogen
from topdress.control.geodesy import TangentPlane
from topdress.control.orders import Do, TargetSource
from topdress.control.targets.index_map import IndexMap
from topdress.control.targets.rate_map import GridMap, make_frame_m
from topdress.drivers.files.run_setup import load_setup

from tests.control_loop.closed import SETUP, Closed

DAY = dt.date(2014, 3, 7)

WIDTH_M = SETUP.machine.geometry.working_width_m
# across the passes
BROOK = Margin(title="Brook", along_m=((-1.2, 60.0), (30.0, 60.0)), margin_m=6.0)
# along the first pass
DITCH = Margin(title="Ditch", along_m=((0.0, -20.0), (0.0, 320.0)), margin_m=1.0)


def landed(closed: Closed, seconds: float) -> np.ndarray:
    """North of where what fell on the first pass, due north, has landed, by the machine's own
    truth."""
    return np.array(
        [
            s.truth.north_m + s.truth.speed_mps * s.truth.drop_s
            for s in closed.through(seconds)
            if s.truth.flow_kg_s > 0.002
        ]
    )


def field(*margins: Margin) -> dict[str, Any]:
    whole = Closed(SETUP).job.field
    return {
        "field": Ground.model_validate(
            whole.model_dump() | {"margins": [one.model_dump() for one in margins]}
        )
    }


def test_nothing_lands_within_a_margin():
    """6 m of a brook that the passes cross: nothing to within 0.3 m, by the landed grains;
    before, all of it."""

    def nearest_m(*margins: Margin) -> float:
        fallen = landed(Closed(**field(*margins)), 75.0)
        assert fallen.max() > 68.0, "it goes on behind the brook"
        return float(np.abs(fallen - 60.0).min())

    assert nearest_m() < 0.2
    assert nearest_m(BROOK) > 6.0 - 0.3


def test_a_pass_whose_edge_lies_within_a_margin_gets_nothing():
    """The whole width keeps off: the first pass is half a width from the ditch, the second one
    and a half."""
    assert len(landed(Closed(**field(DITCH)), 40.0)) == 0
    assert (
        Closed(**field(DITCH))
        .job.field.make_spread_ground(0.5 * WIDTH_M)
        .contains_place(WIDTH_M, 100.0)
    )


def test_the_operator_cannot_open_a_margin():
    closed = Closed(**field(BROOK))
    assert closed.order(Do.ALLOW_OUTSIDE, True).why == "no_spread_margin"
    assert (
        closed.order(Do.ALLOW_OUTSIDE, False).accepted
        and Closed().order(Do.ALLOW_OUTSIDE, True).accepted
    )


def test_margins_of_a_field():
    ground = Ground(
        boundary_m=((0, 0), (0, 100), (50, 100), (50, 0)),
        margins=(Margin(along_m=((0, 0), (0, 100)), margin_m=5.0),),
    )
    inner = ground.make_spread_ground(1.2)
    assert isinstance(inner, Boundary) and inner.area_ha == pytest.approx(
        (50 - 6.2) * 100 / 1e4, rel=1e-3
    )
    assert ground.make_boundary().area_ha == pytest.approx(0.5), "the field's own hectares stay"
    assert not inner.contains_place(6.1, 50.0) and inner.contains_place(6.3, 50.0)
    with pytest.raises(ValueError, match="leave nothing of the field"):
        ground.make_spread_ground(60.0)
    with pytest.raises(ValidationError, match="margins needs boundary_m"):
        Ground(margins=(BROOK,))


@pytest.mark.exam
def test_zones_are_a_factor_of_the_rule():
    """North of 40 m half, north of 60 m nothing: of the targets decided there, to within a
    decision's way."""
    ground = SETUP.job.field
    plane = TangentPlane(ground.origin_lat_deg, ground.origin_lon_deg)
    cells = np.repeat([[1.0], [1.0], [0.5], [0.0]], 2, axis=1)
    zones = IndexMap(GridMap(make_frame_m((-20.0, 0.0), 20.0, 20.0), cells), plane, WIDTH_M)

    def rates(**loop: Any) -> list[float]:
        steps = Closed(loop=loop).through(75.0)
        north = np.array([s.truth.north_m for s in steps])
        target = np.array([s.target_rate_kg_ha for s in steps])
        return [
            float(target[(north > a) & (north < b)].mean())
            for a, b in ((24.0, 37.0), (44.0, 57.0), (64.0, 77.0))
        ]

    plain, zoned = rates(), rates(zone_map=zones)
    assert zoned == pytest.approx([plain[0], 0.5 * plain[1], 0.0], rel=0.02)


def test_a_ceiling_bounds_every_source_and_no_place_gets_it_twice(tmp_path):
    """40 kg N left: 88.9 kg/ha of urea, by the rule, by hand, with the nudge."""
    path = tmp_path / "job.yaml"
    path.write_text("format: topdress-job/1\nnitrogen: {year_max_kg_ha: 100, given_kg_ha: 60}\n")
    setup = load_setup("huanghai", path, DAY)
    most = 40.0 / 0.45
    closed = Closed(setup).start()
    assert (
        closed.order(Do.NO_DOUBLE, False).why == "year_ceiling"
        and closed.order(Do.NO_DOUBLE, True).accepted
    )
    assert closed.order(Do.MANUAL_RATE, 300.0).why == "rate_out_of_range"
    assert closed.order(Do.NUDGE, 30.0).accepted
    closed.run(40.0)
    given = [tick.row.applied_rate_kg_ha or 0.0 for tick in closed.ticks if tick.row.time_s > 20.0]
    assert np.mean(given) == pytest.approx(most, rel=0.02), (
        "the rule wants some 330 kg/ha, and 30 % more"
    )
    assert (
        closed.order(Do.NUDGE, 0.0).accepted
        and closed.order(Do.SOURCE, TargetSource.FALLBACK.value).accepted
    )
    assert closed.run(10.0).row.target_rate_kg_ha == pytest.approx(most)
    assert Job(nitrogen=Nitrogen(year_max_kg_ha=100.0)).no_double
