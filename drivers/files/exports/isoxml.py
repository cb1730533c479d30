"""How is applied work written as an ISO 11783-10 task? The task has totals, device description,
product, field, and time log.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from topdress.drivers.files.exports.as_applied import AsApplied, ExportError, Floats
from topdress.drivers.files.exports.time_log import (
    NO_POSITION_STATUS,
    LoggedData,
    TimeRecord,
    encode_layout,
    encode_records,
)
from topdress.drivers.files.prescriptions.task_files import (
    add_polygon_element,
    clean_task_name,
    make_task_root,
    write_task_files,
)

# Data dictionary identifiers (ISO 11783-11) of rates in mg/m2.
SETPOINT_RATE_DDI, ACTUAL_RATE_DDI = 6, 7
# Identifiers of width (mm), speed (mm/s) and work state (1: working).
WIDTH_DDI, SPEED_DDI, WORK_STATE_DDI = 67, 397, 141
# Identifiers of totals in g, g, m2, mm and s.
TOTAL_MASS_DDI, TOTAL_NITROGEN_DDI, TOTAL_AREA_DDI, TOTAL_DISTANCE_DDI, TOTAL_TIME_DDI = (
    352,
    353,
    116,
    117,
    119,
)
# Values of a time log record, in this order.
LOGGED_DDIS = (
    SETPOINT_RATE_DDI,
    ACTUAL_RATE_DDI,
    WIDTH_DDI,
    SPEED_DDI,
    WORK_STATE_DDI,
    TOTAL_MASS_DDI,
    TOTAL_AREA_DDI,
    TOTAL_DISTANCE_DDI,
)
# Names of the device's process data (DPD), as a terminal shows them.
DDI_NAMES = {
    SETPOINT_RATE_DDI: "target rate",
    ACTUAL_RATE_DDI: "applied rate",
    WIDTH_DDI: "working width",
    SPEED_DDI: "speed",
    WORK_STATE_DDI: "work state",
    TOTAL_MASS_DDI: "applied",
    TOTAL_NITROGEN_DDI: "applied nitrogen",
    TOTAL_AREA_DDI: "area",
    TOTAL_DISTANCE_DDI: "distance",
    TOTAL_TIME_DDI: "working time",
}
# Totals in the task's time element (TIM).
TOTAL_DDIS = (
    TOTAL_MASS_DDI,
    TOTAL_NITROGEN_DDI,
    TOTAL_AREA_DDI,
    TOTAL_DISTANCE_DDI,
    TOTAL_TIME_DDI,
)

# The only device element: the whole machine.
DEVICE_ELEMENT = "DET1"
# ISO 11783 NAME: self-configurable, fertiliser class, without a manufacturer's number.
CLIENT_NAME = "A00084000DE00001"
# Pause between segments, s, that ends the work in the time log.
MIN_WORK_BREAK_S = 0.5


def write_isoxml_task(applied: AsApplied, path: Path, polygons: bool = False) -> None:
    """Writes a task folder, or a zip for a path that ends in .zip. Raises ExportError for a log
    without times, OSError."""
    root, files = build_as_applied_task(applied)
    write_task_files(path, root, files)


def build_as_applied_task(applied: AsApplied) -> tuple[Element, dict[str, bytes]]:
    """Returns the task file's tree and its other files. Raises ExportError."""
    s = applied.stretches
    begin, end = (
        applied.utc(float(s.time_s[at] + sign * 0.5 * s.duration_s[at]))
        for at, sign in ((0, -1), (-1, 1))
    )
    # ISO 11783-10 requires absolute times.
    if begin is None or end is None:
        raise ExportError(
            f"{applied.title}: no UTC in the log: allowed for ISOXML is a log with a column utc or "
            "started_utc next to it"
        )
    root = make_task_root(from_terminal=True)
    # The presentation makes terminals show kg/ha instead of mg/m2.
    SubElement(root, "VPN", A="VPN1", B="0", C="0.01", D="2", E="kg/ha")
    SubElement(root, "PDT", A="PDT1", B=clean_task_name(applied.product.name))
    if applied.field_deg is not None:
        add_polygon_element(
            SubElement(root, "PFD", A="PFD1", C=clean_task_name(applied.title), D="0"),
            [applied.field_deg],
            "1",
        )
    _add_device(root, applied)
    # State 4 of a task is "completed".
    task = SubElement(root, "TSK", A="TSK1", B=clean_task_name(applied.title), G="4")
    if applied.field_deg is not None:
        task.set("E", "PFD1")
    worked = SubElement(
        task,
        "TIM",
        # Begin, end and duration in seconds; type 4 is effective work.
        A=_format_utc(begin),
        B=_format_utc(end),
        C=str(round((end - begin).total_seconds())),
        D="4",
    )
    for ddi, value in zip(TOTAL_DDIS, _round_final_totals(applied), strict=True):
        SubElement(worked, "DLV", A=f"{ddi:04X}", B=str(value), C=DEVICE_ELEMENT)
    SubElement(task, "DAN", A=CLIENT_NAME, C="DVC1")
    SubElement(task, "PAN", A="PDT1", E=DEVICE_ELEMENT)
    binary = encode_records(_iter_time_records(applied))
    SubElement(task, "TLG", A="TLG00001", B=str(len(binary)), C="1")
    return root, {
        "TLG00001.xml": encode_layout([LoggedData(ddi, DEVICE_ELEMENT) for ddi in LOGGED_DDIS]),
        "TLG00001.bin": binary,
    }


def _iter_time_records(applied: AsApplied) -> Iterator[TimeRecord]:
    """Yields a record at the end of each segment, with the sums so far, and a record where work
    stops."""
    s = applied.stretches
    # Sums are rounded after adding, so that rounding errors do not accumulate.
    grams = np.round(1000.0 * np.cumsum(s.applied_kg)).astype(np.int64).tolist()
    square_metres = np.round(np.cumsum(s.area_m2)).astype(np.int64).tolist()
    millimetres = np.round(1000.0 * np.cumsum(_calc_effective_m(applied))).astype(np.int64).tolist()
    ends = s.time_s + 0.5 * s.duration_s
    # The last segment always ends the work.
    stops = np.append(
        s.time_s[1:] - 0.5 * s.duration_s[1:] - ends[:-1] > MIN_WORK_BREAK_S, True
    ).tolist()
    for k, end_s in enumerate(ends.tolist()):
        values = [
            # 100 mg/m2 are 1 kg/ha.
            _round_or_none(100.0 * s.target_kg_ha[k]),
            _round_or_none(100.0 * s.applied_kg_ha[k]),
            round(1000.0 * s.width_m[k]),
            _round_or_none(1000.0 * s.speed_mps[k]),
            1,
            grams[k],
            square_metres[k],
            millimetres[k],
        ]
        yield _make_time_record(applied, k, end_s, values)
        if stops[k]:
            # The record is a millisecond later, because readers expect increasing times.
            yield _make_time_record(
                # Totals are not repeated, because a record holds only changed values.
                applied,
                k,
                end_s + 0.001,
                [None, 0, None, None, 0, None, None, None],
            )


def _calc_effective_m(applied: AsApplied) -> Floats:
    """Returns the effective distance of each segment (n,), m: a section counts by its share of the
    whole width."""
    s = applied.stretches
    return np.asarray(s.length_m * (s.width_m / applied.width_m), dtype=np.float64)


def _make_time_record(
    applied: AsApplied, k: int, time_s: float, values: list[int | None]
) -> TimeRecord:
    s = applied.stretches
    utc = applied.utc(time_s)
    assert utc is not None
    fix, satellites, hdop = s.fix_quality[k], s.satellites[k], s.hdop[k]
    return TimeRecord(
        utc,
        float(s.lat_deg[k]),
        float(s.lon_deg[k]),
        # NaN, an unknown number, is not equal to itself.
        NO_POSITION_STATUS if fix != fix else int(fix),
        None if hdop != hdop else float(hdop),
        None if satellites != satellites else int(satellites),
        values,
    )


def _round_final_totals(applied: AsApplied) -> tuple[int, ...]:
    """Returns the log's own sums in the order of `TOTAL_DDIS`."""
    totals, length_m = applied.totals, float(_calc_effective_m(applied).sum())
    return (
        round(1000.0 * totals.applied_kg),
        round(1000.0 * totals.applied_n_kg),
        round(10_000.0 * totals.area_ha),
        round(1000.0 * length_m),
        round(totals.worked_s),
    )


def _add_device(root: Element, applied: AsApplied) -> None:
    device = SubElement(
        root,
        "DVC",
        A="DVC1",
        B=clean_task_name(applied.machine.id),
        C=root.get("ManagementSoftwareVersion", ""),
        D=CLIENT_NAME,
        F="00000000000001",
        G="FF000000406E65",
    )
    element = SubElement(
        device, "DET", A=DEVICE_ELEMENT, B="1", C="1", D="applicator", E="0", F="0"
    )
    # Each value is described once, even if it is both logged and totalled.
    described = sorted({*LOGGED_DDIS, *TOTAL_DDIS})
    for number, _ in enumerate(described, start=2):
        SubElement(element, "DOR", A=str(number))
    for number, ddi in enumerate(described, start=2):
        SubElement(
            device,
            "DPD",
            A=str(number),
            B=f"{ddi:04X}",
            C="0",
            # Triggers of ISO 11783-10: 16 is total, 1 is time interval.
            D="16" if ddi in TOTAL_DDIS else "1",
            E=DDI_NAMES[ddi],
        )


def _format_utc(moment: dt.datetime) -> str:
    """Returns a UTC as xs:dateTime."""
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def _round_or_none(value: float) -> int | None:
    """Returns a rounded number; None for NaN."""
    return None if value != value else round(value)
