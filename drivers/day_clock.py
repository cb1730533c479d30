"""What day it is, by the computer's clock, whatever that says: one that no date can be made of
(Python's time ends in 2262, some systems' begins in 1970) costs no start and no tick. All of
the program asks here."""

from __future__ import annotations

import datetime as dt
import time

UNKNOWN = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)  # a clock that was never set says the same
_NO_DATE = (OverflowError, OSError, ValueError)
_epoch_s = time.time


def epoch_s() -> float:
    """Seconds since 1970."""
    try:
        return _epoch_s()
    except _NO_DATE:
        return 0.0


def is_set() -> bool:
    """Whether a date can be made of what the clock says."""
    return epoch_s() != 0.0


def utc_now() -> dt.datetime:
    return moment(epoch_s())


def local_now() -> dt.datetime:
    """Without its zone, as file names and lists of files have it."""
    try:
        return dt.datetime.fromtimestamp(epoch_s())
    except _NO_DATE:
        return UNKNOWN.replace(tzinfo=None)


def today() -> dt.date:
    return local_now().date()


def offset_s() -> float:
    """Of local time from UTC."""
    try:
        return float(time.localtime().tm_gmtoff or 0)
    except _NO_DATE:
        return 0.0


def moment(epoch_s: float) -> dt.datetime:
    """UTC of seconds since 1970."""
    try:
        return dt.datetime.fromtimestamp(epoch_s, dt.UTC)
    except _NO_DATE:
        return UNKNOWN


def said_of_file(changed_s: float) -> str:
    """Local date and minute of seconds since 1970; empty where that is no date."""
    try:
        return dt.datetime.fromtimestamp(changed_s).strftime("%Y-%m-%d %H:%M")
    except _NO_DATE:
        return ""
