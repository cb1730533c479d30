"""A console that joins a machine which runs already says so, and by which files that machine
goes."""

from __future__ import annotations

from typing import NamedTuple

from topdress.console.app.pages.job.checklist import find_file_name
from topdress.console.app.view import format_local_time
from topdress.console.locale import _


class JoinedMachine(NamedTuple):
    """Describes the machine that this console has joined.

    started_utc: of the control worker. files: that it runs with, empty: those that are shipped.
    unused: named on this command line, and not in use there. known: whether that could be read;
    else `unused` is all that was named here, used or not. named: all that was.
    """

    started_utc: str = ""
    log_path: str = ""
    files: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    known: bool = True
    named: tuple[str, ...] = ()


def describe_attachment(joined: JoinedMachine, utc_offset_s: float) -> str:
    """The text that the operator reads before all else."""
    since = format_local_time(joined.started_utc, utc_offset_s)[:5] or "--"
    lines = [
        _("It has been on since {time}. This console has joined it and changed nothing.").format(
            time=since
        )
    ]
    if joined.files:
        lines.append(
            _("Its files: {files}").format(files=", ".join(map(find_file_name, joined.files)))
        )
    if joined.log_path:
        lines.append(_("log {name}").format(name=find_file_name(joined.log_path)))
    named = ", ".join(map(find_file_name, joined.unused))
    if not joined.known:
        lines.append(_("Its files are not known: nothing can be read next to its log."))
        if named:
            lines.append(
                _("Named on this command line, and perhaps NOT used: {files}.").format(files=named)
            )
    elif joined.unused:
        lines.append(
            _(
                "NOT used, though named on this command line: {files}. F10 takes another "
                "job, crop or machine."
            ).format(files=named)
        )
    return "\n".join(lines)
