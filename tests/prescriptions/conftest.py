"""Small prescriptions that several tests share."""

from __future__ import annotations

import numpy as np
import pytest
from topdress.control.field.boundary import Boundary
from topdress.control.targets.prescription import Fallbacks, Prescription
from topdress.control.targets.rate_map import GridMap, make_frame_m


@pytest.fixture
def chequered() -> Prescription:
    """10 m cells, 12 x 12, each with a rate of its own; a field that cuts the border cells
    obliquely."""
    rates = 100.0 + np.arange(144.0).reshape(12, 12)
    field = Boundary([(4.0, 3.0), (113.0, 8.0), (118.0, 97.0), (61.0, 116.0), (7.0, 88.0)])
    return Prescription(
        GridMap(make_frame_m((0.0, 0.0), 10.0, 10.0), rates), Fallbacks(80.0, 5.0, 60.0), [field]
    )
