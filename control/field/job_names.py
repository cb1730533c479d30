"""Whose job it is, where, of what, by whom: names that people give, for screens and sheets.
They decide nothing."""

from __future__ import annotations

from typing import NamedTuple


class JobNames(NamedTuple):
    """Empty: nobody said so. product_file: of the library, what `product` names."""

    client: str = ""
    farm: str = ""
    field: str = ""
    product: str = ""
    operator: str = ""
    product_file: str = ""
