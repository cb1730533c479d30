"""Which row of the list that `--about` names belongs to which log, and which values does it
contain?
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from topdress.console.services.fleet_job import SHARED_WORDS, find_epoch_days

LIST_COLUMNS = ("log", "unit", *SHARED_WORDS, "time")


class ListedLogs(NamedTuple):
    """Holds the rows of the list by log. `of` has the values of each log's row, `unused` a line for
    each row without a log, with the reason, and `silent` the number of logs without a row."""

    of: Mapping[str, Mapping[str, str]]
    unused: tuple[str, ...]
    silent: int


def match_rows(rows: Sequence[Mapping[str, str]], logs: Sequence[str]) -> ListedLogs:
    """Returns the log of each row: the log whose path ends with the row's path, folder by folder.

    A path that was written on another computer matches by the end of the log's given path. A row
    that matches several logs belongs to none. `rows` have the columns of LIST_COLUMNS. Raises
    ValueError for a wrong time.
    """
    parts = {log: _split_path(log) for log in logs}
    ends = Counter("/".join(one[k:]) for one in parts.values() for k in range(len(one)))
    by_end = {"/".join(one[k:]): log for log, one in parts.items() for k in range(len(one))}
    whole = {"/".join(one): log for log, one in parts.items()}
    of, unused = dict[str, Mapping[str, str]](), list[str]()
    for number, row in enumerate(rows, 1):
        said = _split_path(row["log"])
        path, longer = "/".join(said), ["/".join(said[k:]) for k in range(1, len(said))]
        log = whole.get(path) or (by_end.get(path) if ends[path] == 1 else None)
        log = log or (
            None if ends[path] else next((whole[end] for end in longer if end in whole), None)
        )
        if row.get("time"):
            try:
                find_epoch_days(row["time"])
            except ValueError:
                raise ValueError(
                    f"row {number}: time {row['time']}: allowed is ISO 8601, as "
                    "2026-04-01T08:00:00+08:00"
                ) from None
        if log is None or log in of:
            why = (
                "its log has a row already"
                if log
                else f"{ends[path]} logs end so"
                if ends[path]
                else "no such log"
            )
            unused.append(f"row {number}: {row['log']}: {why}")
        else:
            of[log] = row
    return ListedLogs(of, tuple(unused), len(logs) - len(of))


def _split_path(path: str) -> list[str]:
    return [part for part in path.strip().replace("\\", "/").split("/") if part not in ("", ".")]


def apply_list_row(record: Mapping[str, Any], row: Mapping[str, str]) -> dict[str, Any]:
    """Returns a log's record with the values of its row in place of its sidecar's."""
    time = {"time_d": find_epoch_days(row["time"]), "time_from": "list"} if row.get("time") else {}
    return {
        **record,
        "unit": row.get("unit") or record["unit"],
        **time,
        "shared": {name: row.get(name) or said for name, said in record["shared"].items()},
    }
