"""Degrees to metres: against formulas of another make, and against the papers' own figures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.control.geodesy import (
    TangentPlane,
    calc_corrected_paper_distance_m,
    calc_ellipsoid_distance_m,
    calc_paper_distance_m,
    calc_plane_distance_m,
    calc_turn_deg,
    find_unit_vector,
    offset_place,
)

LATITUDES = st.floats(-75.0, 75.0)
LONGITUDES = st.floats(-180.0, 180.0)
METRES = st.floats(-2000.0, 2000.0)


def enu(lat0: float, lon0: float, lat: float, lon: float) -> np.ndarray:
    """East, north, up by rotation matrices, with the axes of the ellipsoid instead of its
    eccentricity."""
    a, b = 6378137.0, 6356752.314245179

    def xyz(phi: float, lam: float) -> np.ndarray:
        phi, lam = np.radians(phi), np.radians(lam)
        n = a * a / np.hypot(a * np.cos(phi), b * np.sin(phi))
        return np.array(
            [
                n * np.cos(phi) * np.cos(lam),
                n * np.cos(phi) * np.sin(lam),
                b * b / a / a * n * np.sin(phi),
            ]
        )

    phi, lam = np.radians(lat0), np.radians(lon0)
    about_axis = np.array(
        [[-np.sin(lam), np.cos(lam), 0], [-np.cos(lam), -np.sin(lam), 0], [0, 0, 1]]
    )
    tilt = np.array([[1, 0, 0], [0, np.sin(phi), np.cos(phi)], [0, -np.cos(phi), np.sin(phi)]])
    return tilt @ about_axis @ (xyz(lat, lon) - xyz(lat0, lon0))


def vincenty_m(lat1: float, lon1: float, lat2: float, lon2: float) -> float:
    """Vincenty's inverse formula (Survey Review 1975)."""
    a, f = 6378137.0, 1 / 298.257223563
    b = a * (1 - f)
    u1, u2 = (math.atan((1 - f) * math.tan(math.radians(v))) for v in (lat1, lat2))
    big_l = lam = math.radians(lon2 - lon1)
    for _ in range(50):
        sin_s = math.hypot(
            math.cos(u2) * math.sin(lam),
            math.cos(u1) * math.sin(u2) - math.sin(u1) * math.cos(u2) * math.cos(lam),
        )
        if sin_s == 0.0:
            return 0.0
        cos_s = math.sin(u1) * math.sin(u2) + math.cos(u1) * math.cos(u2) * math.cos(lam)
        sigma = math.atan2(sin_s, cos_s)
        sin_a = math.cos(u1) * math.cos(u2) * math.sin(lam) / sin_s
        cos2_a = 1 - sin_a**2
        # 0: on the equator
        cos_2m = cos_s - 2 * math.sin(u1) * math.sin(u2) / cos2_a if cos2_a > 0.0 else 0.0
        c = f / 16 * cos2_a * (4 + f * (4 - 3 * cos2_a))
        before, lam = (
            lam,
            big_l
            + (1 - c)
            * f
            * sin_a
            * (sigma + c * sin_s * (cos_2m + c * cos_s * (2 * cos_2m**2 - 1))),
        )
        if abs(lam - before) < 1e-15:
            break
    u_sq = cos2_a * (a * a - b * b) / (b * b)
    big_a = 1 + u_sq / 16384 * (4096 + u_sq * (-768 + u_sq * (320 - 175 * u_sq)))
    big_b = u_sq / 1024 * (256 + u_sq * (-128 + u_sq * (74 - 47 * u_sq)))
    delta = (
        big_b
        * sin_s
        * (
            cos_2m
            + big_b
            / 4
            * (
                cos_s * (2 * cos_2m**2 - 1)
                - big_b / 6 * cos_2m * (4 * sin_s**2 - 3) * (4 * cos_2m**2 - 3)
            )
        )
    )
    return b * big_a * (sigma - delta)


@settings(deadline=None)
@given(LATITUDES, LONGITUDES, METRES, METRES)
def test_plane_there_and_back(lat, lon, east, north):
    plane = TangentPlane(lat, lon)
    assert plane.project_to_m(*plane.convert_to_deg(east, north)) == pytest.approx(
        (east, north), abs=1e-6
    )


@settings(deadline=None)
@given(LATITUDES, LONGITUDES, METRES, METRES)
def test_plane_against_rotated_earth_centred_coordinates(lat, lon, east, north):
    plane = TangentPlane(lat, lon)
    place = plane.convert_to_deg(east, north)
    expected = enu(lat, lon, *place)
    assert plane.project_to_m(*place) == pytest.approx(tuple(expected[:2]), abs=1e-3)
    assert abs(expected[2]) < 1.0


@settings(deadline=None)
@given(LATITUDES, LONGITUDES, st.floats(0.0, 360.0), st.floats(0.1, 2000.0))
def test_plane_against_geodesics(lat, lon, heading, far):
    plane = TangentPlane(lat, lon)
    place = plane.convert_to_deg(*offset_place((0.0, 0.0), heading, far))
    assert vincenty_m(lat, lon, *place) == pytest.approx(far, abs=1e-3)
    assert calc_ellipsoid_distance_m(lat, lon, *place) == pytest.approx(far, abs=1e-3)


def test_origin_and_axes():
    plane = TangentPlane(40.0, 116.0)
    assert plane.project_to_m(40.0, 116.0) == (0.0, 0.0)
    assert plane.project_to_m(40.0001, 116.0) == pytest.approx((0.0, 11.1035), abs=1e-3)
    assert plane.project_to_m(40.0, 116.0001) == pytest.approx((8.5394, 0.0), abs=1e-3)
    assert plane.convert_to_deg(0.0, 0.0) == (40.0, 116.0)


def test_across_the_date_line():
    plane = TangentPlane(-17.0, 179.9999)
    east, _ = plane.project_to_m(-17.0, -179.9999)
    assert east == pytest.approx(21.3, abs=0.1)
    assert plane.convert_to_deg(east, 0.0)[1] == pytest.approx(-179.9999, abs=1e-9)


def test_a_whole_track_as_its_places():
    plane = TangentPlane(34.3, 119.9)
    lat, lon = 34.3 + np.linspace(0, 0.02, 7), 119.9 - np.linspace(0, 0.02, 7)
    track = plane.project_many_to_m(lat, lon)
    assert track.shape == (7, 2)
    for row, place in zip(track, zip(lat, lon, strict=True), strict=True):
        assert tuple(row) == pytest.approx(plane.project_to_m(*place), abs=1e-9)
    assert np.isnan(plane.project_many_to_m([math.nan], [119.9])).all()


def test_nonsense_is_refused():
    with pytest.raises(ValueError, match="allowed is latitude"):
        TangentPlane(116.0, 40.0)
    with pytest.raises(ValueError, match="within 100 km"):
        TangentPlane(40.0, 116.0).convert_to_deg(math.nan, 0.0)
    with pytest.raises(ValueError, match="within 100 km"):
        TangentPlane(40.0, 116.0).convert_to_deg(2e5, 0.0)


@pytest.mark.parametrize("far", [0.001, 10.0, 1000.0, 20_000.0])
@pytest.mark.parametrize("heading", [0.0, 45.0, 90.0, 200.0])
def test_distance_keeps_its_digits(far, heading):
    lat, lon = TangentPlane(40.0, 116.0).convert_to_deg(*offset_place((0.0, 0.0), heading, far))
    assert calc_ellipsoid_distance_m(40.0, 116.0, lat, lon) == pytest.approx(
        vincenty_m(40.0, 116.0, lat, lon), abs=1e-3
    )
    assert calc_ellipsoid_distance_m(lat, lon, lat, lon) == 0.0


def test_what_the_printed_distance_costs():
    """Paper B, eq 3: 10 m east at 40 N (on its own sphere) comes out as 8.39 m; 10 m north
    stays."""
    east = math.degrees(10.0 / (6356755.0 * math.cos(math.radians(40.0))))
    assert calc_paper_distance_m(40.0, 116.0, 40.0, 116.0 + east) == pytest.approx(8.39, abs=0.005)
    north = math.degrees(10.0 / 6356755.0)
    assert calc_paper_distance_m(40.0, 116.0, 40.0 + north, 116.0) == pytest.approx(10.0, abs=0.001)


def test_what_the_papers_radius_costs():
    lat, lon = TangentPlane(40.0, 116.0).convert_to_deg(1000.0, 0.0)
    short = 1.0 - calc_corrected_paper_distance_m(40.0, 116.0, lat, lon) / 1000.0
    assert 100.0 * short == pytest.approx(0.47, abs=0.005)


def test_turns():
    assert calc_turn_deg(350.0, 10.0) == pytest.approx(20.0)
    assert calc_turn_deg(10.0, 350.0) == pytest.approx(-20.0)
    assert calc_turn_deg(0.0, 180.0) == calc_turn_deg(180.0, 0.0) == 180.0


@settings(deadline=None)
@given(st.floats(0.0, 359.99), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_offset_is_a_rotation(heading, forward, right):
    east, north = offset_place((7.0, -3.0), heading, forward, right)
    ahead, side = find_unit_vector(heading), find_unit_vector(heading + 90.0)
    assert (east - 7.0) * ahead[0] + (north + 3.0) * ahead[1] == pytest.approx(forward, abs=1e-6)
    assert (east - 7.0) * side[0] + (north + 3.0) * side[1] == pytest.approx(right, abs=1e-6)


def test_distance_on_the_plane():
    assert calc_plane_distance_m((0, 0), (3, 4)) == 5.0
