"""How are the JSON objects of gpsd decoded? Each TCP line is one object: TPV is a fix, SKY lists
its satellites, VERSION is the greeting.
"""

from __future__ import annotations

import json
import re
from datetime import datetime
from typing import Any

from topdress.control.readings import GnssFix
from topdress.drivers.devices.device import Receiver
from topdress.drivers.devices.gnss import NEW_CLOCK_DELAY_S
from topdress.drivers.devices.lines import IgnoredSentence, LineDecoder, RejectedSentence
from topdress.drivers.devices.nmea import MAX_HDOP, MAX_SPEED_MPS

# Command that makes gpsd report every fix as JSON.
WATCH_COMMAND = b'?WATCH={"enable":true,"json":true};\n'
# Fix quality of GGA for each status of gpsd (gpsd_json(5), TPV).
QUALITY_OF_STATUS = {0: 1, 1: 1, 2: 2, 3: 4, 4: 5, 5: 6, 6: 6, 7: 1, 8: 8, 9: 3}
_UTC_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z")


class GpsdDecoder(LineDecoder[GnssFix]):
    """Decodes bytes of a gpsd connection to fixes. The cab sends `WATCH` after every connection.

    Counted as rejected: `malformed` (no JSON object), `impossible_value`, `time_backwards`,
    `duplicate_epoch`, `overlong`. Counted as ignored: every other class by its name, `no_fix`,
    `other_device` (gpsd may serve several receivers; the first receiver with a fix is used).
    """

    longest = 16384
    # An idle gpsd sends one banner at the connection.
    min_recognised = 1

    def __init__(self) -> None:
        super().__init__()
        self._device: str | None = None
        self._utc = ""
        self._behind_since_s: float | None = None
        self._satellites: int | None = None
        self._hdop: float | None = None

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[GnssFix]:
        try:
            report = json.loads(sentence)
        except (ValueError, RecursionError):
            report = None
        if not isinstance(report, dict):
            raise RejectedSentence("malformed")
        return self._take_object(report, time_s)

    def _take_object(self, report: dict[str, Any], time_s: float) -> list[GnssFix]:
        name = report.get("class")
        if not isinstance(name, str):
            raise RejectedSentence("malformed")
        if name == "POLL":
            return self._take_poll(report, time_s)
        if name not in ("TPV", "SKY"):
            raise IgnoredSentence(name if name.isalpha() and len(name) < 20 else "other")
        if self._device is not None and report.get("device", self._device) != self._device:
            raise IgnoredSentence("other_device")
        return self._make_fix(report, time_s) if name == "TPV" else self._take_sky(report)

    def _take_poll(self, report: dict[str, Any], time_s: float) -> list[GnssFix]:
        """Returns the fixes in an answer to ?POLL, which has the newest reports of each receiver;
        only the receiver in use counts."""
        found: list[GnssFix] | IgnoredSentence | RejectedSentence = IgnoredSentence("POLL")
        for name, kind in (("sky", "SKY"), ("tpv", "TPV")):
            reports = report.get(name, [])
            if not isinstance(reports, list) or not all(isinstance(one, dict) for one in reports):
                raise RejectedSentence("malformed")
            for one_report in reports:
                try:
                    taken: list[GnssFix] | IgnoredSentence | RejectedSentence = self._take_object(
                        {**one_report, "class": kind}, time_s
                    )
                except (IgnoredSentence, RejectedSentence) as why:
                    taken = why
                if not (isinstance(found, list) and found) or (isinstance(taken, list) and taken):
                    found = taken
        if not isinstance(found, list):
            raise found
        return found

    def _take_sky(self, report: dict[str, Any]) -> list[GnssFix]:
        hdop, used = (
            _read_number(report, "hdop", 0.0, MAX_HDOP),
            _read_number(report, "uSat", 0, 200),
        )
        if hdop is None and used is None:
            raise IgnoredSentence("SKY")
        self._hdop = hdop if hdop is not None else self._hdop
        self._satellites = int(used) if used is not None else self._satellites
        return []

    def _make_fix(self, report: dict[str, Any], time_s: float) -> list[GnssFix]:
        mode = _read_number(report, "mode", 0, 3)
        if mode is None:
            raise RejectedSentence("malformed")
        if mode < 2:
            raise IgnoredSentence("no_fix")
        lat_deg, lon_deg = (
            _read_number(report, "lat", -90.0, 90.0),
            _read_number(report, "lon", -180.0, 180.0),
        )
        if lat_deg is None or lon_deg is None:
            raise IgnoredSentence("no_fix")
        if lat_deg == 0.0 and lon_deg == 0.0:
            raise RejectedSentence("impossible_value")
        status = _read_number(report, "status", 0, 9)
        heading_deg = _read_number(report, "track", 0.0, 360.0)
        speed_mps = _read_number(report, "speed", 0.0, MAX_SPEED_MPS)
        utc = report.get("time")
        if utc is not None and not _is_utc_text(utc):
            raise RejectedSentence("malformed")
        if utc is not None:
            if utc == self._utc:
                raise RejectedSentence("duplicate_epoch")
            if utc < self._utc and not self._is_new_clock(time_s):
                raise RejectedSentence("time_backwards")
            self._utc, self._behind_since_s = utc, None
        device = report.get("device")
        if isinstance(device, str):
            self._device = device
        return [
            GnssFix(
                time_s,
                lat_deg,
                lon_deg,
                QUALITY_OF_STATUS[int(status or 0)],
                self._satellites,
                self._hdop,
                speed_mps,
                None if heading_deg is None else heading_deg % 360.0,
                None if utc is None else utc[:19] + (utc[19:-1] + ".000")[:4] + "Z",
            )
        ]

    def _is_new_clock(self, time_s: float) -> bool:
        """Returns whether the receiver's earlier time has continued long enough to be its new
        clock."""
        if self._behind_since_s is None:
            self._behind_since_s = time_s
        return time_s - self._behind_since_s >= NEW_CLOCK_DELAY_S


def _is_utc_text(report: object) -> bool:
    if not (isinstance(report, str) and _UTC_TIME.fullmatch(report)):
        return False
    try:
        datetime.fromisoformat(report[:19])
    except ValueError:
        return False
    return True


def _read_number(report: dict[str, Any], key: str, low: float, high: float) -> float | None:
    value = report.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise RejectedSentence("malformed")
    # The comparison is also False for NaN, and it works for integers of any length.
    if not low <= value <= high:
        raise RejectedSentence("impossible_value")
    return float(value)


RECEIVER = Receiver(
    protocol="gpsd",
    captured_as="gpsd",
    make_decoder=lambda live: GpsdDecoder(),
    hello=WATCH_COMMAND,
)
