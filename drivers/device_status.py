"""What is known of one device in the cab? The console needs this, and nothing else of the
drivers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DeviceStatus:
    """Holds what a device's line has counted and received."""

    name: str  # "gnss", "heads", "board"
    port: str
    protocol: str
    connected: bool
    age_s: float | None  # since the last accepted message
    rate_hz: float
    accepted: int
    rejected: int
    last_raw: str = ""
    connects: int = 0  # times the line was opened
    bytes_in: int = 0
    bytes_out: int = 0
    last_error: str = ""
    rejected_kinds: tuple[tuple[str, int], ...] = ()
