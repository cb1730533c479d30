"""What a rig that times starts cannot tell apart: the share of the pace that the stream in the tube sets."""
from __future__ import annotations

import numpy as np
import pytest

from control.machine.fall import drop_s, start_drop_s
from control.machine.landing import carried_s, falls_s
from control.machine.machine import Machine, effect_sizes
from control.machine.plausible import PLAUSIBLE, plausible
from control.machine.start import first_fall_s, with_carried_share

MACHINE = Machine()


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_every_share_has_the_same_starts(share: float) -> None:
    """10 ms: a third of the scatter of lag table 3."""
    fall = with_carried_share(MACHINE, share).fall
    off = [first_fall_s(MACHINE, fall, n) - start_drop_s(fall, n) for n in (10.0, 30.0, 50.0, 70.0)]
    assert np.abs(off).max() < 0.01


def test_singly_the_running_drop_is_the_line_that_eq_6_allows_as_well() -> None:
    """1.7916 - 0.01331 n s: fitted by the referee of this model, with code of his own."""
    fall = with_carried_share(MACHINE, 0.0).fall
    for rpm in (10.0, 40.0, 70.0):
        assert drop_s(fall, rpm) == pytest.approx(1.7916 - 0.01331 * rpm, abs=0.005)
    assert drop_s(fall, 70.0) < drop_s(MACHINE.fall, 70.0) - 0.3, "and a third of a second quicker than carried along"


def test_there_and_back_is_the_same_machine() -> None:
    again = with_carried_share(with_carried_share(MACHINE, 0.0), 1.0)
    for rpm in (10.0, 40.0, 70.0):
        assert drop_s(again.fall, rpm) == pytest.approx(drop_s(MACHINE.fall, rpm), abs=0.003)
    with pytest.raises(ValueError, match=r"carried_share 1\.5: allowed 0 to 1"):
        with_carried_share(MACHINE, 1.5)


def test_the_share_goes_from_each_granule_s_own_fall_to_the_stream_s() -> None:
    time_s = np.arange(0.0, 8.0, 0.05)
    rpm = np.where(time_s < 4.0, 40.0, 80.0)
    settled = np.array([drop_s(MACHINE.fall, n) for n in rpm.tolist()])
    assert falls_s(time_s, settled, 1.0) == pytest.approx(carried_s(time_s, settled))
    assert falls_s(time_s, settled, 0.0) == pytest.approx(settled)
    late = int(np.searchsorted(time_s, 3.5))        # released before the step, still falling after it
    each = [falls_s(time_s, settled, share)[late] for share in (0.0, 0.3, 0.6, 1.0)]
    assert each == sorted(each, reverse=True) and each[0] - each[-1] > 0.1


def test_the_set_has_the_machines_that_it_says() -> None:
    assert plausible(MACHINE, "singly").fall.carried_share == 0.0 and plausible(MACHINE, "carried_along") == MACHINE
    assert effect_sizes(plausible(MACHINE, "flow_6_more")) == {"flow.gain": 6.0}
    assert effect_sizes(plausible(MACHINE, "field_lag")) == {"lag.offset": 0.3}
    slow = plausible(MACHINE, "slow_drives")
    assert slow.shaft.dead_time_s == pytest.approx(1.2 * 0.373) and slow.gate.slew_mm_s == pytest.approx(20.0 / 1.2)
    assert len({plausible(MACHINE, name).model_dump_json() for name in PLAUSIBLE}) == len(PLAUSIBLE), "no two alike"
    with pytest.raises(ValueError, match="plausible machine 'falling': allowed carried_along, singly"):
        plausible(MACHINE, "falling")
