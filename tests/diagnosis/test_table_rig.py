"""A lag rig counts the drop from 2 r/min on, while the shaft speeds up: its tables accuse no sound machine."""
from __future__ import annotations

import numpy as np
import pytest

from control.diagnosis.tables import diagnose_tables
from control.machine.fall import drop_s
from control.machine.machine import Machine
from drivers.files.bench_table import read_bench_table

SPEEDS_RPM = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0)


def rig_table(path, machine, late_s=0.0, seed=3):
    """Ten repeats at each speed: the shaft begins, the first granule falls at the pace of the stream behind it."""
    rng, lines = np.random.default_rng(seed), ["replicate,shaft_rpm,response_s,drop_s"]
    for repeat in range(1, 11):
        for target in SPEEDS_RPM:
            t, rpm, step, way, begun = 0.0, 0.0, 0.0005, 0.0, None
            while way < 1.0:
                rate = (target - rpm) / machine.shaft.time_constant_s
                rpm += step * min(max(rate, -machine.shaft.acceleration_rpm_s), machine.shaft.acceleration_rpm_s)
                t += step
                if rpm >= 2.0:
                    begun = t if begun is None else begun
                    way += step / drop_s(machine.fall, rpm)
            heard = t - begun
            response = machine.shaft.dead_time_s + begun
            lines.append(f"{repeat},{target:g},{response + rng.normal(0, 0.008):.4f},"
                         f"{heard + late_s + rng.normal(0, 0.02):.4f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_bench_table(path)


def verdict(table):
    found = diagnose_tables([table], Machine())
    return found.verdict, {cause.id: cause.size.value for cause in found.causes}


def test_a_sound_machine_is_not_accused(tmp_path):
    assert verdict(rig_table(tmp_path / "rig.csv", Machine()))[1] == {}


def test_what_falls_late_is_still_found(tmp_path):
    _said, causes = verdict(rig_table(tmp_path / "rig.csv", Machine(), late_s=0.15))
    assert list(causes) == ["lag.offset"]
    assert causes["lag.offset"] == pytest.approx(0.15, abs=0.02)
