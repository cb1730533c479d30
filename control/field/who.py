"""Whose job it is, where, of what, by whom: names that people give, for screens and sheets. They decide nothing."""
from __future__ import annotations

from typing import NamedTuple


class Who(NamedTuple):
    """Empty: nobody said so."""

    client: str = ""
    farm: str = ""
    field: str = ""
    product: str = ""
    operator: str = ""
