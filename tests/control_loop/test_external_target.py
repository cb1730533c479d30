"""The target of another display: what holds while it is silent, and that no silence begins flow."""

from __future__ import annotations

import numpy as np
import pytest
from topdress.control.field.coverage import Raster
from topdress.control.field.job import Wanted
from topdress.control.field.job_totals import NO_SUMS
from topdress.control.orders import TargetSource
from topdress.control.readings import Reading

from tests.control_loop.closed import STEP_S, Closed

SILENT_KG_HA = 120.0


class OtherDisplay:
    """A closed loop whose job takes its target from another display."""

    def __init__(self, silent_kg_ha: float | None) -> None:
        wanted = Wanted(source=TargetSource.EXTERNAL, external_silent_kg_ha=silent_kg_ha)
        self.closed = Closed(
            sim={"begin_m": 10.0, "passes": 1, "pass_length_m": 400.0}, target=wanted
        )
        self._told: Reading | None = None

    def run(self, seconds: float, rate_kg_ha: float | None = None) -> OtherDisplay:
        """rate_kg_ha: told once a second; None: the display is silent."""
        for k in range(round(seconds / STEP_S)):
            self.closed.tick(lambda m, k=k: self._with_target(m, k, rate_kg_ha))
        return self

    def _with_target(self, m, k, rate_kg_ha):
        if rate_kg_ha is not None and k % round(1.0 / STEP_S) == 0:
            self._told = Reading(rate_kg_ha, m.time_s)
        return m._replace(rate_asked=self._told)

    @property
    def row(self):
        return self.closed.ticks[-1].row

    @property
    def kg_s(self) -> float:
        """Largest flow of the last two seconds."""
        return max(truth.flow_kg_s for truth in self.closed.truths[-round(2.0 / STEP_S) :])


# at 1.25 m/s the demo machine gives nothing below some 7 kg/ha
@pytest.mark.parametrize("nothing_kg_ha", [0.0, 0.001, 5.0])
@pytest.mark.parametrize("silent_kg_ha", [None, SILENT_KG_HA])
def test_what_was_last_wanted_as_nothing_stays_nothing_until_the_display_speaks(
    nothing_kg_ha, silent_kg_ha
):
    display = OtherDisplay(silent_kg_ha)
    display.closed.start()
    display.run(5.0, 200.0).run(4.0, nothing_kg_ha).run(8.0)
    assert display.kg_s < 1e-6 and display.row.target_rate_kg_ha == 0.0
    silent = next(one for one in display.closed.ticks[-1].alarms if one.id == "target_silent")
    assert dict(silent.details) == {"silent_kg_ha": 0}
    assert "zero_silent" in display.closed.ticks[-1].notes
    assert display.run(4.0, 200.0).row.target_rate_kg_ha == 200.0 and display.kg_s > 1e-3


@pytest.mark.parametrize("silent_kg_ha", [None, 0.0, SILENT_KG_HA])
@pytest.mark.parametrize("heard", [True, False])
def test_a_silent_display_gives_what_the_job_says_and_else_nothing(silent_kg_ha, heard):
    display = OtherDisplay(silent_kg_ha)
    display.closed.start()
    if heard:
        display.run(5.0, 200.0)
    display.run(7.0)
    assert display.row.target_rate_kg_ha == (silent_kg_ha or 0.0)
    assert (display.kg_s > 1e-3) == bool(silent_kg_ha)


def test_a_job_that_goes_on_waits_for_the_display_whatever_the_job_says():
    display = OtherDisplay(SILENT_KG_HA)
    display.closed.loop.resume_job(NO_SUMS, Raster(0.0, 0.0, 0.2, np.zeros((1, 1), np.bool_)), None)
    display.closed.start()
    assert display.run(6.0).row.target_rate_kg_ha == 0.0 and display.kg_s < 1e-6
    display.run(3.0, 200.0).run(5.0)
    assert display.row.target_rate_kg_ha == SILENT_KG_HA
