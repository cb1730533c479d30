"""The canopy of a whole run at once is the canopy of its ticks."""
from __future__ import annotations

import numpy as np
import pytest

from control.field.job import Canopy
from control.simulation.canopy import AcrossWidth, CanopyField


@pytest.mark.parametrize("index", ["ndvi", "ndre"])
def test_means_over_a_run_are_those_of_its_places_to_the_last_bit(index: str) -> None:
    across = AcrossWidth(CanopyField(Canopy(), (-10.0, 300.0), (-30.0, 400.0), 3), 6, 2.4, index)
    draw = np.random.default_rng(1)
    east, north = draw.uniform(-500.0, 500.0, 400), draw.uniform(-500.0, 900.0, 400)
    heading = draw.choice([0.0, 180.0, 33.3, 271.2], 400)
    places = zip(east.tolist(), north.tolist(), heading.tolist(), strict=True)
    one_by_one = [sum(read) / len(read) for read in (across.at(*place) for place in places)]
    assert across.means(east, north, heading).tolist() == one_by_one
