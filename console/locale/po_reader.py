"""Reads gettext's .po format: msgid, msgstr, continued lines and comments."""

from __future__ import annotations

import ast


def read_po(text: str, name: str = "catalogue") -> dict[str, str]:
    """Return the msgstr of every msgid; the header (empty msgid) and entries marked fuzzy are
    omitted.

    Raises ValueError with file and line for an unreadable line.
    """
    texts: dict[str, str] = {}
    fields: dict[str, str] = {}
    current = ""
    fuzzy = False

    def finish_entry() -> None:
        if fields.get("msgid") and not fuzzy:
            texts[fields["msgid"]] = fields.get("msgstr", "")

    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if line.startswith("#"):
            # A fuzzy translation was guessed by a tool from a similar text, so it may be wrong.
            if line.startswith("#,") and "fuzzy" in line:
                finish_entry()
                fields, fuzzy = {}, True
            continue
        if not line:
            continue
        keyword, _space, quoted = (
            line.partition(" ") if line.startswith("msg") else (current, "", line)
        )
        if keyword not in ("msgid", "msgstr"):
            raise ValueError(
                f"{name}, line {number}: {line[:40]!r} is not understood; allowed: msgid, msgstr, #"
            )
        if keyword == "msgid" and line.startswith("msgid") and "msgid" in fields:
            finish_entry()
            fields, fuzzy = {}, False
        current = keyword
        try:
            # A quoted text of .po has the syntax of a Python string.
            piece = ast.literal_eval(quoted)
        except (SyntaxError, ValueError):
            raise ValueError(
                f"{name}, line {number}: {quoted[:40]!r} is not a quoted text"
            ) from None
        fields[keyword] = fields.get(keyword, "") + piece
    finish_entry()
    return texts
