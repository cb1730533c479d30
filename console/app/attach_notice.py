"""Words the notice of a console that joins a running machine: since when it runs and with which
files.
"""

from __future__ import annotations

from typing import NamedTuple

from topdress.console.app.pages.job.checklist import find_file_name
from topdress.console.app.panel_views import format_local_time
from topdress.console.locale import _


class JoinedMachineFacts(NamedTuple):
    """Describes the machine that this console has joined.

    Attributes
    ----------
    started_utc
        UTC at which the control worker started.
    log_path
        Run log that the worker writes.
    files
        Files that the machine runs with; empty means the shipped defaults.
    unused
        Files named on this console's command line that the machine does not use. Where `known` is
        False, all named files.
    known
        True if the machine's files could be read next to its log.
    named
        All files named on this console's command line.
    """

    started_utc: str = ""
    log_path: str = ""
    files: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    known: bool = True
    named: tuple[str, ...] = ()


def describe_attachment(joined: JoinedMachineFacts, utc_offset_s: float) -> str:
    """Return the text that the operator reads first on a console that joined a machine."""
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
    # The operator must learn that a file named on the command line has no effect: a map of another
    # field would otherwise seem to be in use.
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
