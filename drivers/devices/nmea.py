"""How is one NMEA 0183 sentence read? pynmea2 splits the fields; checksum, address and ranges are
checked here.
"""

from __future__ import annotations

import math
import operator
import re
from datetime import date, time
from functools import reduce
from typing import Any, NamedTuple

import pynmea2
from topdress.drivers.devices.lines import ForeignSentence, IgnoredSentence, RejectedSentence

# Talkers of satellite receivers by constellation. Any other two letters belong to a program or
# instrument that passes a position on (IN integrated navigation, EC chart display, II, ...); P
# begins the private sentences of a manufacturer.
GNSS_TALKERS = frozenset({"GP", "GN", "GL", "GA", "GB", "BD", "GI", "GQ", "QZ"})
_TALKER = re.compile(r"[A-OQ-Z][A-Z0-9]|Q[A-Z]")
# Number of fields that each type needs for the values read here.
MIN_FIELD_COUNT = {"GGA": 10, "RMC": 9, "VTG": 8, "GNS": 8, "GLL": 6, "ZDA": 4}

MPS_PER_KNOT = 1852.0 / 3600.0
# Upper limit of a ground vehicle's speed, m/s.
MAX_SPEED_MPS = 100.0
# GPS begins in 1980; the two digits of a year in RMC reach to 2099.
FIRST_GPS_YEAR, LAST_RMC_YEAR = 1980, 2099
# Receivers write 99.99 for an unknown dilution of precision.
MAX_HDOP = 100.0
# Mode letters of GNS from the best fix to none.
MODES_BEST_FIRST = "RFPDAEMS"
# Fix quality of GGA for each mode of RMC.
QUALITY_OF_MODE = {"A": 1, "D": 2, "P": 3, "R": 4, "F": 5, "E": 6, "M": 7, "S": 8}

_TIME_DIGITS = re.compile(r"\d{6}(\.\d+)?")
_DATE_DIGITS = re.compile(r"\d{6}")
# Degrees take two digits, minutes two; a shorter number has lost a digit on the line.
_LATITUDE = re.compile(r"\d{4}\.\d+")
_LONGITUDE = re.compile(r"\d{5}\.\d+")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")
_HEX_PAIR = re.compile(rb"[0-9A-Fa-f]{2}")
_ADDRESS = re.compile(r"[A-Z][A-Z0-9]{2,7}")


class Sentence(NamedTuple):
    """Holds the content of a GGA, RMC, VTG, GNS, GLL or ZDA. None means that the field was
    empty."""

    type: str
    talker: str
    time_of_day_ms: int | None = None
    date: date | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    fix_quality: int | None = None
    satellites: int | None = None
    hdop: float | None = None
    speed_mps: float | None = None
    heading_deg: float | None = None


def calc_checksum(payload: bytes) -> int:
    """Returns the exclusive or of all bytes between `$` and `*`."""
    return reduce(operator.xor, payload, 0)


def seal_sentence(payload: str) -> bytes:
    """Returns a sentence from the text between `$` and `*`."""
    data = payload.encode("ascii")
    return b"$%b*%02X\r\n" % (data, calc_checksum(data))


def parse_sentence(sentence: bytes) -> Sentence:
    """Returns the content of one sentence, which comes without `$` and line end.

    Raises
    ------
    RejectedSentence : `missing_checksum`, `bad_checksum`, `malformed`, `impossible_value`.
    IgnoredSentence : the sentence type (with its talker where that is unknown), or `no_fix` where
    the receiver reports no position or no speed.
    """
    text = _verify_checksum(sentence)
    address, _, rest = text.partition(",")
    if not _ADDRESS.fullmatch(address):
        raise RejectedSentence("malformed")
    talker, kind = address[:2], address[2:]
    if len(address) != 5 or not _TALKER.fullmatch(talker):
        raise ForeignSentence(address)
    if kind not in MIN_FIELD_COUNT:
        raise IgnoredSentence(kind) if talker in GNSS_TALKERS else ForeignSentence(kind)
    if rest.count(",") + 1 < MIN_FIELD_COUNT[kind]:
        raise RejectedSentence("malformed")
    try:
        fields = pynmea2.parse("$" + text)
    except pynmea2.ParseError:
        raise RejectedSentence("malformed") from None
    return _SENTENCE_READERS[kind](talker, fields)


def _verify_checksum(sentence: bytes) -> str:
    """Returns the text before `*` if its checksum is right. Raises RejectedSentence otherwise."""
    payload, star, given = sentence.partition(b"*")
    given = given.strip()
    if not star or not given:
        raise RejectedSentence("missing_checksum")
    if not _HEX_PAIR.fullmatch(given):
        raise RejectedSentence("malformed")
    if int(given, 16) != calc_checksum(payload):
        raise RejectedSentence("bad_checksum")
    try:
        text = payload.decode("ascii")
    except UnicodeDecodeError:
        raise RejectedSentence("malformed") from None
    if not text.isprintable():
        raise RejectedSentence("malformed")
    return text


def _read_gga(talker: str, fields: Any) -> Sentence:
    quality = _read_whole(str(fields.data[5]), 0, 9)
    if not quality:
        raise IgnoredSentence("no_fix")
    lat_deg, lon_deg = _read_position(fields)
    return Sentence(
        "GGA",
        talker,
        time_of_day_ms=_read_time_of_day_ms(fields),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        fix_quality=quality,
        satellites=_read_whole(fields.num_sats, 0, 200),
        hdop=_read_number(fields.horizontal_dil, 0.0, MAX_HDOP),
    )


def _read_rmc(talker: str, fields: Any) -> Sentence:
    if fields.status == "V":
        raise IgnoredSentence("no_fix")
    if fields.status != "A":
        raise RejectedSentence("malformed")
    lat_deg, lon_deg = _read_position(fields)
    mode = fields.mode_indicator
    if mode == "N":
        raise IgnoredSentence("no_fix")
    if mode and mode not in QUALITY_OF_MODE:
        raise RejectedSentence("malformed")
    speed_knots = _read_number(fields.data[6], 0.0, MAX_SPEED_MPS / MPS_PER_KNOT)
    return Sentence(
        "RMC",
        talker,
        time_of_day_ms=_read_time_of_day_ms(fields),
        date=_read_date(fields),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        fix_quality=QUALITY_OF_MODE.get(mode, 1),
        speed_mps=None if speed_knots is None else speed_knots * MPS_PER_KNOT,
        heading_deg=_read_heading_deg(fields.data[7]),
    )


def _read_vtg(talker: str, fields: Any) -> Sentence:
    knots = _read_number(fields.data[4], 0.0, MAX_SPEED_MPS / MPS_PER_KNOT)
    kmh = _read_number(fields.data[6], 0.0, MAX_SPEED_MPS * 3.6)
    if fields.faa_mode == "N" or (knots is None and kmh is None):
        raise IgnoredSentence("no_fix")
    speed_mps = knots * MPS_PER_KNOT if knots is not None else (kmh or 0.0) / 3.6
    return Sentence(
        "VTG", talker, speed_mps=speed_mps, heading_deg=_read_heading_deg(fields.data[0])
    )


def _read_gns(talker: str, fields: Any) -> Sentence:
    """Returns the content of a GNS. It has a mode letter for each constellation; the best letter is
    the mode of the fix."""
    modes = fields.data[5]
    if not modes or set(modes) - set(QUALITY_OF_MODE) - {"N"}:
        raise RejectedSentence("malformed")
    best = next((mode for mode in MODES_BEST_FIRST if mode in modes), "N")
    if best == "N":
        raise IgnoredSentence("no_fix")
    lat_deg, lon_deg = _read_position(fields)
    return Sentence(
        "GNS",
        talker,
        time_of_day_ms=_read_time_of_day_ms(fields),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        fix_quality=QUALITY_OF_MODE[best],
        satellites=_read_whole(fields.data[6], 0, 200),
        hdop=_read_number(fields.data[7], 0.0, MAX_HDOP),
    )


def _read_gll(talker: str, fields: Any) -> Sentence:
    mode = fields.data[6] if len(fields.data) > 6 else ""
    if fields.data[5] == "V" or mode == "N":
        raise IgnoredSentence("no_fix")
    if fields.data[5] != "A" or (mode and mode not in QUALITY_OF_MODE):
        raise RejectedSentence("malformed")
    lat_deg, lon_deg = _read_position(fields)
    return Sentence(
        "GLL",
        talker,
        time_of_day_ms=_read_time_of_day_ms(fields, 4),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        fix_quality=QUALITY_OF_MODE.get(mode, 1),
    )


def _read_zda(talker: str, fields: Any) -> Sentence:
    """Returns the content of a ZDA, which is empty before the receiver knows the date."""
    day, month, year = fields.data[1:4]
    if not (fields.data[0] and day and month and year):
        raise IgnoredSentence("ZDA")
    numbers = [_read_whole(text, 0, 9999) or 0 for text in (year, month, day)]
    try:
        utc_date = date(*numbers)
    except ValueError:
        raise RejectedSentence("impossible_value") from None
    if not FIRST_GPS_YEAR <= utc_date.year <= LAST_RMC_YEAR:
        raise RejectedSentence("impossible_value")
    return Sentence("ZDA", talker, time_of_day_ms=_read_time_of_day_ms(fields), date=utc_date)


_SENTENCE_READERS = {
    "GGA": _read_gga,
    "RMC": _read_rmc,
    "VTG": _read_vtg,
    "GNS": _read_gns,
    "GLL": _read_gll,
    "ZDA": _read_zda,
}


def _read_number(text: str, low: float, high: float) -> float | None:
    if not text:
        return None
    if not _NUMBER.fullmatch(text):
        raise RejectedSentence("malformed")
    value = float(text)
    if not low <= value <= high or not math.isfinite(value):
        raise RejectedSentence("impossible_value")
    return value


def _read_whole(text: str, low: int, high: int) -> int | None:
    if text and not text.isdecimal():
        raise RejectedSentence("malformed")
    value = _read_number(text, low, high)
    return None if value is None else int(value)


def _read_heading_deg(text: str) -> float | None:
    course_deg = _read_number(text, 0.0, 360.0)
    return None if course_deg is None else course_deg % 360.0


def _read_time_of_day_ms(fields: Any, at_field: int = 0) -> int:
    if not _TIME_DIGITS.fullmatch(fields.data[at_field]):
        raise RejectedSentence("malformed")
    at = fields.timestamp
    # pynmea2 returns the text itself where it cannot read a time.
    if not isinstance(at, time):
        raise RejectedSentence("impossible_value")
    return (at.hour * 3600 + at.minute * 60 + at.second) * 1000 + round(at.microsecond / 1000)


def _read_date(fields: Any) -> date | None:
    text = fields.data[8]
    if not text:
        return None
    if not _DATE_DIGITS.fullmatch(text):
        raise RejectedSentence("malformed")
    day = fields.datestamp
    if not isinstance(day, date):
        raise RejectedSentence("impossible_value")
    return day


def _read_position(fields: Any) -> tuple[float, float]:
    """Returns latitude and longitude in signed degrees. Exactly 0, 0 is a receiver's "unknown" and
    raises IgnoredSentence."""
    if not (_LATITUDE.fullmatch(fields.lat) and _LONGITUDE.fullmatch(fields.lon)):
        raise RejectedSentence("malformed")
    if fields.lat_dir not in ("N", "S") or fields.lon_dir not in ("E", "W"):
        raise RejectedSentence("malformed")
    lat_deg, lon_deg = fields.latitude, fields.longitude
    if float(fields.lat) % 100.0 >= 60.0 or float(fields.lon) % 100.0 >= 60.0:
        raise RejectedSentence("impossible_value")
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0 or (lat_deg == 0.0 and lon_deg == 0.0):
        raise RejectedSentence("impossible_value")
    return lat_deg, lon_deg
