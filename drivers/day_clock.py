"""Which day is it by the computer's clock? A clock that gives no valid date stops neither a start
nor a tick. Python's time ends in 2262, and the time of some systems begins in 1970. The whole
program gets dates here.
"""

from __future__ import annotations

import datetime as dt
import time

# A clock that was never set shows the same date.
DATE_OF_UNSET_CLOCK = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
# Exceptions of Python for a time that is no valid date.
_DATE_ERRORS = (OverflowError, OSError, ValueError)
_read_epoch_s = time.time


def read_epoch_s() -> float:
    """Returns the seconds since 1970."""
    try:
        return _read_epoch_s()
    except _DATE_ERRORS:
        return 0.0


def is_clock_set() -> bool:
    """Returns whether the clock gives a valid date."""
    return read_epoch_s() != 0.0


def read_utc_now() -> dt.datetime:
    """Returns the present date and time in UTC."""
    return convert_to_utc(read_epoch_s())


def read_local_now() -> dt.datetime:
    """Returns the local time without its zone, as it appears in file names and lists of files."""
    try:
        return dt.datetime.fromtimestamp(read_epoch_s())
    except _DATE_ERRORS:
        return DATE_OF_UNSET_CLOCK.replace(tzinfo=None)


def read_today() -> dt.date:
    """Returns the local date."""
    return read_local_now().date()


def read_utc_offset_s() -> float:
    """Returns the offset of local time from UTC, s; positive in the east."""
    try:
        return float(time.localtime().tm_gmtoff or 0)
    except _DATE_ERRORS:
        return 0.0


def convert_to_utc(epoch_s: float) -> dt.datetime:
    """Returns the UTC date and time of seconds since 1970."""
    try:
        return dt.datetime.fromtimestamp(epoch_s, dt.UTC)
    except _DATE_ERRORS:
        return DATE_OF_UNSET_CLOCK


def format_file_time(changed_s: float) -> str:
    """Returns local date and minute of seconds since 1970; empty where they are no valid date."""
    try:
        return dt.datetime.fromtimestamp(changed_s).strftime("%Y-%m-%d %H:%M")
    except _DATE_ERRORS:
        return ""
