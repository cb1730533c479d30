"""Which day is it by the computer's clock? A clock that no date can be made from (Python's time
ends in 2262, some systems' begins in 1970) stops no start and no tick. All of the program asks
here."""

from __future__ import annotations

import datetime as dt
import time

UNKNOWN = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)  # a clock that was never set says the same
_NO_DATE = (OverflowError, OSError, ValueError)
_epoch_s = time.time


def epoch_s() -> float:
    """Returns the seconds since 1970."""
    try:
        return _epoch_s()
    except _NO_DATE:
        return 0.0


def is_set() -> bool:
    """Returns whether the clock gives a date."""
    return epoch_s() != 0.0


def utc_now() -> dt.datetime:
    """Returns the present UTC."""
    return moment(epoch_s())


def local_now() -> dt.datetime:
    """Returns the local time without its zone, as in file names and lists of files."""
    try:
        return dt.datetime.fromtimestamp(epoch_s())
    except _NO_DATE:
        return UNKNOWN.replace(tzinfo=None)


def today() -> dt.date:
    """Returns the local date."""
    return local_now().date()


def offset_s() -> float:
    """Returns the offset of local time from UTC, s."""
    try:
        return float(time.localtime().tm_gmtoff or 0)
    except _NO_DATE:
        return 0.0


def moment(epoch_s: float) -> dt.datetime:
    """Converts seconds since 1970 to UTC."""
    try:
        return dt.datetime.fromtimestamp(epoch_s, dt.UTC)
    except _NO_DATE:
        return UNKNOWN


def said_of_file(changed_s: float) -> str:
    """Returns local date and minute of seconds since 1970; empty where that is no date."""
    try:
        return dt.datetime.fromtimestamp(changed_s).strftime("%Y-%m-%d %H:%M")
    except _NO_DATE:
        return ""
