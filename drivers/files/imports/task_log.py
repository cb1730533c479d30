"""How do the time logs of an ISO 11783-10 task set become a single table? The requested logs are
chosen, joined, and the other contents of a task file described.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from topdress.control.log_row import LOG_BEGINS
from topdress.control.recordings.finding import Finding, many
from topdress.drivers import day_clock
from topdress.drivers.files.columns import Columns, count_rows, make_text_column, stack_tables
from topdress.drivers.files.imports.device_description import (
    DeviceElement,
    NumberMeaning,
    find_width_m,
    read_device_elements,
)
from topdress.drivers.files.imports.import_errors import LogImportError, format_list
from topdress.drivers.files.imports.mapping import EVENTS_COLUMN, Source
from topdress.drivers.files.imports.raw_table import RawTable, make_unique
from topdress.drivers.files.imports.time_logs import (
    UTC_COLUMN,
    LoggedValue,
    TimeLog,
    build_time_log_columns,
    calc_worked_ha,
    find_log_width,
    read_time_logs,
)
from topdress.drivers.files.imports.units import find_named_unit
from topdress.drivers.files.prescriptions.task_files import choose_task_set, read_task_tree

# Options by which an operator chooses, for messages.
CHOICE_OPTIONS = (
    "--task, --device and --log (source.task, .device and .task_log of the import file)"
)
# Largest number of logs in a message, one in each line.
MAX_LISTED_LOGS = 60


class TaskLogs(NamedTuple):
    """Holds the logs of completed work in a task set."""

    root: Element
    parts: dict[str, DeviceElement]
    logs: list[TimeLog]


def read_task_log(path: Path, said: Source) -> RawTable:
    """Returns the time logs of a task as a table.

    The logs are joined by their times. A number that a record does not hold keeps its last value,
    because a device logs on change.

    Parameters
    ----------
    path : a task file, its folder or a zip.
    said : names task, device or log of a task set with several.

    Raises
    ------
    LogImportError : the task set has no log, or it is unclear which log is meant.
    RefusedInput : the task set cannot be used, in one line.
    OSError : the task set cannot be read.
    """
    found = find_task_logs(path, said.inside)
    if found is None:
        raise LogImportError(path, "no TASKDATA.XML there")
    return _read_chosen_logs(path, found, said)


def find_task_logs(path: Path, inside: str | None = None) -> TaskLogs | None:
    """Returns the time logs of a task set; None without a task file. Raises RefusedInput,
    OSError."""
    files = choose_task_set(path, inside)
    if files is None:
        return None
    # Devices may be described in external files, so the whole tree is read before any log.
    root = read_task_tree(files)
    parts = read_device_elements(root)
    return TaskLogs(root, parts, read_time_logs(files, root, parts))


def _read_chosen_logs(path: Path, found: TaskLogs, said: Source) -> RawTable:
    """Returns the table of the chosen logs. Raises LogImportError."""
    # A task set without time logs holds plans only.
    if not found.logs:
        raise LogImportError(
            path,
            "no time log (TLG) in its tasks: allowed is a task that was worked (what is to be "
            "applied is read by topdress map)",
        )
    logs = _choose_logs(path, found, said)
    findings = [
        Finding(
            "cut_row",
            f"{log.name}.bin: {log.lost} bytes at its end are no whole record: left out",
            rows=1,
        )
        for log in logs
        if log.lost
    ]
    # A log without records is harmless next to others, but a damaged log may hide part of the work.
    if empty := [log for log in logs if log.trouble]:
        # If no log is readable, all reasons are listed, because the operator cannot choose another.
        if len(empty) == len(logs):
            raise LogImportError(path, *(f"{log.name}: {log.trouble}" for log in logs))
        if gone := [log for log in empty if "no record" not in log.trouble]:
            raise LogImportError(
                path, *(f"{log.name}: {log.trouble}: --log takes another" for log in gone)
            )
        findings.append(
            Finding(
                "empty_logs",
                f"{many(len(empty), 'time log')} without a record left out "
                f"({format_list(log.name for log in empty)})",
            )
        )
    # Records of several logs are joined by time, so the logs must be in the order of their begins.
    logs = sorted((log for log in logs if not log.trouble), key=lambda log: log.first_us)
    _check_no_overlap(path, found, logs)
    # The same value occurs in several logs of a task; the key removes these repetitions.
    logged = list(
        {
            (one.ddi, one.element): one
            for log in logs
            for one in log.logged
            if said.device is None or _is_of_device(one, said.device)
        }.values()
    )
    # The decision is made before names are given, because it changes the units of the columns.
    presented = _is_by_presentation(path, logged, said, findings)
    names = _name_columns(logs, logged)
    columns = _join_logs(logs, names, presented)
    units = {
        names[one.ddi, one.element]: (one.shown if presented and one.shown else one.meaning).unit
        for one in logged
        if (one.ddi, one.element) in names
    }
    findings += _describe_elements(logged, names)
    if len(logs) > 1:
        findings.append(
            Finding(
                "joined_logs",
                f"{len(logs)} time logs of task {logs[0].task} joined by their times: "
                f"{format_list(log.name for log in logs)}",
            )
        )
    # The task is recorded only if the set has several, so that a later import finds the same one.
    several = len({log.task for log in found.logs}) > 1
    source = said.model_copy(
        update={
            "kind": "isoxml",
            "task": said.task or (logs[0].task if several and not said.task_log else None),
            "task_log": said.task_log,
        }
    )
    return RawTable(
        path,
        columns,
        source,
        {name: unit for name, unit in units.items() if unit},
        1,
        tuple(findings),
        utc=frozenset({UTC_COLUMN}),
        width_m=_find_shared_width(found, logs, logged),
    )


def _choose_logs(path: Path, found: TaskLogs, said: Source) -> list[TimeLog]:
    """Returns the logs of a single task. Raises LogImportError with a line for each log."""
    # All three choices are applied together, so that their message lists every remaining log.
    logs = [
        log
        for log in found.logs
        if _is_chosen(said.task_log, log.name)
        and _is_chosen(said.task, log.task, log.title)
        and (said.device is None or any(_is_of_device(one, said.device) for one in log.logged))
    ]
    chosen = [
        f"{word} {value}"
        for word, value in (("log", said.task_log), ("task", said.task), ("device", said.device))
        if value is not None
    ]
    if not logs:
        raise LogImportError(
            path,
            f"{', '.join(chosen)}: no such time log: allowed with {CHOICE_OPTIONS} are",
            *describe_logs(found),
        )
    # Logs of different tasks are never joined, because their products and fields may differ.
    tasks = {log.task for log in logs}
    if len(tasks) > 1:
        raise LogImportError(
            path,
            f"{len(logs)} time logs of {len(tasks)} tasks: say which with {CHOICE_OPTIONS}",
            *describe_logs(found._replace(logs=logs)),
        )
    return logs


def _is_chosen(wanted: str | None, *names: str) -> bool:
    return wanted is None or wanted.strip().casefold() in [
        name.strip().casefold() for name in names
    ]


def _is_of_device(one: LoggedValue, device: str) -> bool:
    return one.part is not None and _is_chosen(device, one.part.device, one.part.device_name)


def describe_logs(found: TaskLogs) -> list[str]:
    """Returns a line for each time log: its task, device, dates, rows, hectares and columns."""
    lines = [_describe_log(log, found) for log in found.logs[:MAX_LISTED_LOGS]]
    # A long list would push the first lines out of a terminal.
    more = len(found.logs) - MAX_LISTED_LOGS
    return [*lines, f"... {many(more, 'more time log')}"] if more > 0 else lines


def _describe_log(log: TimeLog, found: TaskLogs) -> str:
    title = f" ({log.title})" if log.title else ""
    devices = (
        format_list(f"{key} ({name})" if name else key for key, name in log.devices.items())
        or "no device described"
    )
    where = f"task {log.task}{title}, log {log.name}, device {devices}"
    if log.trouble:
        return f"{where}: {log.trouble}"
    # The counted area is more exact than distance times width, and its source is named.
    area = calc_worked_ha(log, found.parts)
    size = "hectares not given" if area is None else f"{area[0]:.3f} ha ({area[1]})"
    names = format_list(dict.fromkeys(one.meaning.name for one in log.logged), 8)
    return (
        f"{where}: {_format_moment(log.first_us)} to {_format_moment(log.last_us)}, "
        f"{many(log.rows)}, "
        f"{size}; {names}"
    )


def _format_moment(us: int) -> str:
    """Returns a UTC time as text, from microseconds since 1970."""
    return f"{day_clock.convert_to_utc(us / 1e6):%Y-%m-%d %H:%M:%S}"


def _check_no_overlap(path: Path, found: TaskLogs, logs: Sequence[TimeLog]) -> None:
    """Refuses logs that overlap in time. Raises LogImportError."""
    for before, after in pairwise(logs):
        # An equal time counts as overlap too, because two records of one moment cannot be ordered.
        if after.first_us <= before.last_us:
            raise LogImportError(
                path,
                f"{after.name} begins {_format_moment(after.first_us)}, before {before.name} ends "
                f"{_format_moment(before.last_us)}: allowed are logs that follow one another; say "
                f"which with {CHOICE_OPTIONS}",
                *describe_logs(found._replace(logs=list(logs))),
            )


def _is_by_presentation(
    path: Path, logged: Sequence[LoggedValue], said: Source, findings: list[Finding]
) -> bool:
    """Returns whether rates are taken from the device's presentation. Raises LogImportError where
    that is undecided and matters."""
    odd = [one for one in logged if one.shown is not None]
    if not odd:
        return False
    # One example is sufficient, because a device uses the same wrong step for all of its rates.
    one = odd[0]
    assert one.shown is not None
    text = (
        f"{one.meaning.name} ({one.element}): 100 is {_format_in_log_unit(one.meaning)} by DDI "
        f"{one.ddi or 0:04X}, and "
        f"{_format_in_log_unit(one.shown)} as the device shows it"
    )
    # Either reading may be a wrong dose by a factor of ten, so the program never chooses.
    if said.values_from is None:
        raise LogImportError(
            path, f"{text}: say which holds: --values-from ddi or presentation (source.values_from)"
        )
    findings.append(Finding("presentation", f"{text}: taken by {said.values_from}"))
    return said.values_from == "presentation"


def _format_in_log_unit(meaning: NumberMeaning) -> str:
    """Returns a raw number of 100, in the log's unit of its quantity, as text."""
    unit = find_named_unit(meaning.unit)
    # A sample of 100 makes the ratio of both readings visible in the message.
    value = 100.0 * meaning.step + meaning.offset
    if unit is None or unit.quantity not in ("rate", "flow"):
        return f"{value:g} {meaning.unit}"
    return f"{value * unit.factor:g} {'kg/ha' if unit.quantity == 'rate' else 'kg/s'}"


def _name_columns(
    logs: Sequence[TimeLog], logged: Sequence[LoggedValue]
) -> dict[tuple[int | None, str], str]:
    """Returns the column name of each number: its meaning, and the element where several have this
    meaning. Elements that always have the same numbers share a column."""
    names: dict[tuple[int | None, str], str] = {}
    taken = set(logs[0].heads) if logs and logs[0].heads is not None else set()
    for name in dict.fromkeys(one.meaning.name for one in logged):
        # Boom sections often repeat the value of the machine; repeated columns are dropped.
        alike = _drop_repeats([one for one in logged if one.meaning.name == name], logs)
        wanted = [name] if len(alike) == 1 else [f"{name} ({one.element})" for one in alike]
        # Names of position columns are reserved, so that no value hides a position.
        free = make_unique([*sorted(taken), *wanted])[len(taken) :]
        names |= {
            (one.ddi, one.element): one_name for one, one_name in zip(alike, free, strict=True)
        }
        taken |= set(free)
    return names


def _drop_repeats(alike: list[LoggedValue], logs: Sequence[TimeLog]) -> list[LoggedValue]:
    """Returns the numbers without those that equal an earlier number in every record."""
    kept: list[LoggedValue] = []
    for one in alike:
        if not any(all(_is_same_number(log, one, other) for log in logs) for other in kept):
            kept.append(one)
    return kept


def _is_same_number(log: TimeLog, one: LoggedValue, other: LoggedValue) -> bool:
    # The same value may have different row numbers in different logs.
    rows = [
        next(
            (
                k
                for k, value in enumerate(log.logged)
                if (value.ddi, value.element) == (it.ddi, it.element)
            ),
            None,
        )
        for it in (one, other)
    ]
    # A log that lacks both values does not distinguish them.
    if log.values is None or rows[0] is None or rows[1] is None:
        return rows[0] == rows[1]
    return (
        bool(np.array_equal(log.values[rows[0]], log.values[rows[1]], equal_nan=True))
        and one.ddi == other.ddi
    )


def _join_logs(
    logs: Sequence[TimeLog], names: dict[tuple[int | None, str], str], presented: bool
) -> Columns:
    """Returns the logs as a single table, with an event at the beginning of each."""
    tables = []
    for log in logs:
        columns = build_time_log_columns(log, names, presented)
        # A single log needs no mark, because the log begins with it.
        if len(logs) > 1:
            mark = [f"{LOG_BEGINS}{log.name}", *[""] * (count_rows(columns) - 1)]
            columns[EVENTS_COLUMN] = make_text_column(mark)
        tables.append(columns)
    return stack_tables(tables)


def _describe_elements(
    logged: Sequence[LoggedValue], names: dict[tuple[int | None, str], str]
) -> list[Finding]:
    """Returns a finding that names the elements in columns' names."""
    # Only elements that appear in a column's name need an explanation.
    shown = {
        one.element: one.part
        for one in logged
        if names.get((one.ddi, one.element), "").endswith(f"({one.element})")
    }
    words = [
        f"{element} is {part.name or 'an element'} of {part.device_name or part.device}"
        for element, part in shown.items()
        if part is not None
    ]
    return [Finding("elements", format_list(words))] if words else []


def _find_shared_width(
    found: TaskLogs, logs: Sequence[TimeLog], logged: Sequence[LoggedValue]
) -> float | None:
    """Returns the working width, m, that all logs share; None for an unknown or changing width."""
    widths = {find_log_width(log, found.parts) for log in logs}
    # Different widths mean that sections were switched, so no single width is correct.
    if len(widths) == 1:
        return widths.pop()
    devices = {one.part.device for one in logged if one.part is not None}
    return (
        find_width_m(found.parts, devices.pop())
        if len(devices) == 1 and None not in widths
        else None
    )


# Attribute DataTransferOrigin of ISO 11783-10.
ORIGIN_TEXTS = {
    "1": "written before the work, by farm software",
    "2": "written after it, by a task controller",
}


def describe_task_file(path: Path) -> list[str] | None:
    """Returns the contents of a task file, one line each; None without a task file. Raises
    RefusedInput, OSError."""
    found = find_task_logs(path)
    if found is None:
        return None
    root = found.root
    origin = ORIGIN_TEXTS.get(root.get("DataTransferOrigin", ""), "origin not given")
    lines = [
        f"{path}: task file, version "
        f"{root.get('VersionMajor', '?')}.{root.get('VersionMinor', '?')}, {origin}"
        # Plans and completed work are both listed, because a task file may hold either.
    ]
    for task in root.findall("TSK"):
        lines.append(f"{path}: {_describe_task(root, task)}")
    for field in root.findall("PFD"):
        area = field.get("D", "")
        lines.append(
            f"{path}: field {_format_name(field, 'C')}"
            # The area is stored in m2 as an integer; 0 means that no program has computed it.
            + (f", {int(area) / 10_000:.4f} ha as it says" if area.isdigit() and int(area) else "")
        )
    for product in root.findall("PDT"):
        lines.append(f"{path}: product {_format_name(product, 'B')}")
    for device in root.findall("DVC"):
        lines.append(f"{path}: {_describe_device(device, found.parts)}")
    return [*lines, *(f"{path}: {line}" for line in describe_logs(found))]


def _format_name(element: Element, attribute: str) -> str:
    name = element.get(attribute, "")
    return element.get("A", "") + (f" ({name})" if name else "")


def _describe_task(root: Element, task: Element) -> str:
    held = [
        many(len(task.findall(tag)), what)
        for tag, what in (("TZN", "treatment zone"), ("GRD", "grid"), ("TLG", "time log"))
        if task.find(tag) is not None
    ]
    field = next(
        (_format_name(one, "C") for one in root.findall("PFD") if one.get("A") == task.get("E")), ""
    )
    return (
        f"task {_format_name(task, 'B')}: "
        f"{format_list(held) or 'nothing planned and nothing logged'}"
        + (f"; field {field}" if field else "")
    )


def _describe_device(device: Element, parts: dict[str, DeviceElement]) -> str:
    width = find_width_m(parts, device.get("A"))
    own = [part for part in parts.values() if part.device == device.get("A")]
    # Type 4 of ISO 11783-10 is a section.
    sections = sum(part.kind == "4" for part in own)
    words = [f"{width:g} m wide" if width is not None else "width not given"]
    words += [many(sections, "section")] if sections else []
    return (
        f"device {_format_name(device, 'B')}: {', '.join(words)}; elements "
        f"{format_list(f'{part.id} {part.name}'.strip() for part in own)}"
    )
