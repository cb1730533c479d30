"""What the real devices would write: a fix as NMEA, a canopy sample as the heads' lines, the drives as status lines."""
from __future__ import annotations

from datetime import UTC, datetime, timedelta

from control.readings import GnssFix
from drivers.devices.canopy_heads import HeadFields
from drivers.devices.nmea import MPS_PER_KNOT, checksum

MODE_OF_QUALITY = {1: "A", 2: "D", 3: "P", 4: "R", 5: "F", 6: "E", 7: "M", 8: "S"}
FIRST_MOMENT = datetime(2026, 4, 1, 6, 0, 0, tzinfo=UTC)    # where a fix carries no UTC of its own


def sentence(payload: str) -> bytes:
    """An NMEA sentence from what stands between `$` and `*`."""
    data = payload.encode("ascii")
    return b"$%b*%02X\r\n" % (data, checksum(data))


def gnss_sentences(fix: GnssFix, talker: str = "GN") -> bytes:
    """One epoch as GGA, RMC and VTG. Positions to 1e-7 minutes (0.2 mm), speeds to 0.001 knots.

    Without `fix.utc` the time is `FIRST_MOMENT` plus `fix.time_s`. Quality 0: no position is written, status V.
    """
    at = datetime.fromisoformat(fix.utc) if fix.utc else FIRST_MOMENT + timedelta(seconds=fix.time_s)
    at = (at + timedelta(microseconds=500)).astimezone(UTC)     # cut to milliseconds below
    clock = f"{at:%H%M%S}.{at.microsecond // 1000:03d}"
    valid = fix.fix_quality > 0
    place = f"{_minutes(fix.lat_deg, 2, 'NS')},{_minutes(fix.lon_deg, 3, 'EW')}" if valid else ",,,"
    mode = MODE_OF_QUALITY.get(fix.fix_quality, "A") if valid else "N"
    satellites = "" if fix.satellites is None else f"{fix.satellites:02d}"
    hdop = "" if fix.hdop is None else f"{fix.hdop:.2f}"
    knots = "" if fix.speed_mps is None else f"{fix.speed_mps / MPS_PER_KNOT:.3f}"
    kmh = "" if fix.speed_mps is None else f"{fix.speed_mps * 3.6:.3f}"
    course = "" if fix.heading_deg is None else f"{fix.heading_deg % 360.0:.3f}"
    return (sentence(f"{talker}GGA,{clock},{place},{fix.fix_quality},{satellites},{hdop},0.0,M,0.0,M,,")
            + sentence(f"{talker}RMC,{clock},{'A' if valid else 'V'},{place},{knots},{course},{at:%d%m%y},,,{mode}")
            + sentence(f"{talker}VTG,{course},T,,M,{knots},N,{kmh},K,{mode}"))


def head_line(ndvi: float, layout: HeadFields, head: int | None = None) -> bytes:
    """One sample of one head in the given layout; `head` writes the multiplexed line's `H<n>,` in front.

    The second index repeats the NDVI; fields that the driver does not read are 0.
    """
    fields = ["0"] * layout.fields
    for number in (layout.index_2, layout.ndvi):
        if number:
            fields[number - 1] = f"{ndvi:.3f}"
    prefix = "" if head is None else f"H{head},"
    return f"{prefix}{','.join(fields)}\r\n".encode("ascii")


def _minutes(degrees: float, width: int, letters: str) -> str:
    """`4807.0380000,N`: whole degrees, then minutes, rounded together so that 60 minutes never appear."""
    ten_millionths = round(abs(degrees) * 60e7)
    whole, minutes = divmod(ten_millionths, 600_000_000)
    return f"{whole:0{width}d}{minutes // 10_000_000:02d}.{minutes % 10_000_000:07d},{letters[degrees < 0.0]}"
