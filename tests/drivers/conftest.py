"""Shared by the driver tests: a clock that is set by hand, sentences made independently, a
small plant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from topdress.control.readings import DriveCommand, GnssFix
from topdress.control.simulation.plant import SensorReadings

from tests.places import RECEIVERS


class HandClock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> HandClock:
    return HandClock()


@pytest.fixture(scope="session")
def nmea() -> Callable[[str], bytes]:
    """Payload to sentence; the checksum is computed here, not by the code under test."""

    def seal(payload: str) -> bytes:
        total = 0
        for letter in payload:
            total ^= ord(letter)
        return f"${payload}*{total:02X}\r\n".encode()

    return seal


@pytest.fixture(scope="session")
def board_line() -> Callable[[str], bytes]:
    """Payload to a board frame; the CRC is computed bit by bit here, not by the code under test."""

    def seal(payload: str) -> bytes:
        crc = 0xFFFF
        for byte in payload.encode():
            crc ^= byte << 8
            for _ in range(8):
                crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
        return f"${payload}*{crc:04X}\r\n".encode()

    return seal


@pytest.fixture(scope="session")
def recordings() -> list[Path]:
    return sorted(RECEIVERS.glob("*.log"))


class FakePlant:
    """Drives follow at once; GNSS at 5 Hz, heads at 2 Hz; the wheel turns at `speed_mps`, 16
    pulses in 2.5 m."""

    def __init__(self, dt_s: float = 0.05, heads: int = 6) -> None:
        self.dt_s = dt_s
        self.heads = heads
        self.speed_mps = 1.25
        self.steps = 0
        self.way_m = 0.0
        self.commands: list[tuple[DriveCommand, bool]] = []

    def advance_plant(self, command: DriveCommand, enabled: bool) -> SensorReadings:
        self.steps += 1
        self.way_m += self.speed_mps * self.dt_s
        self.commands.append((command, enabled))
        now_s = self.steps * self.dt_s
        pulses = int(self.way_m / 0.15625 + 1e-9)
        over_m = self.way_m - pulses * 0.15625
        fix = GnssFix(
            now_s,
            34.28 + self.way_m / 111_195.0,
            119.88,
            4,
            14,
            0.8,
            self.speed_mps,
            359.9,
            f"2026-04-01T06:{int(now_s) // 60:02d}:{int(now_s) % 60:02d}"
            f".{round(now_s * 1000) % 1000:03d}Z",
        )
        ndvi = tuple(0.40 + 0.01 * head for head in range(self.heads))
        return SensorReadings(
            now_s,
            fix if self.steps % round(0.2 / self.dt_s) == 0 else None,
            self.speed_mps,
            pulses,
            ndvi if self.steps % round(0.5 / self.dt_s) == 0 else None,
            command.shaft_rpm if enabled else 0.0,
            command.opening_mm,
            250.05,
            13.5,
            1.5,
            -0.5,
            True,
            now_s - (over_m / self.speed_mps if self.speed_mps else 0.0),
        )


@pytest.fixture
def fake_plant() -> FakePlant:
    return FakePlant()
