"""What is the state of one device in the cab? The console needs only this record of the drivers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DeviceStatus:
    """Holds the counts and the last message of a device's line."""

    # Name of the device, such as "gnss", "heads" or "board".
    name: str
    port: str
    protocol: str
    connected: bool
    # Time since the last accepted message, s; None before the first.
    age_s: float | None
    rate_hz: float
    accepted: int
    rejected: int
    last_raw: str = ""
    # Number of times the line was opened.
    connects: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    last_error: str = ""
    rejected_kinds: tuple[tuple[str, int], ...] = ()
