"""Names of a job for screens and sheets: client, farm, field, product, operator. They have no
effect on control.
"""

from __future__ import annotations

from typing import NamedTuple


class JobNames(NamedTuple):
    """Names of a job; an empty name means that none was given. product_file: id in the library
    of the product `product`."""

    client: str = ""
    farm: str = ""
    field: str = ""
    product: str = ""
    operator: str = ""
    product_file: str = ""
