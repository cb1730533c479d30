"""How does a machine meter a product? By the flow of that product's newest catch test with the
machine.
"""

from __future__ import annotations

import datetime as dt

from topdress.control.agronomy.product import Product

from .machine import Adopted, Machine

# Parameters that a catch test determines.
CATCH_TEST_PARAMETERS = (
    "flow.grams_per_rev_mm",
    "flow.gain",
    "flow.zero_offset",
    "flow.fill_falloff",
)


def find_newest_test_date(machine: Machine) -> dt.date | None:
    """Returns the day of the newest catch test behind the machine's flow; None for no test or an
    unknown day."""
    days = [
        one.date
        for one in machine.adopted
        if one.id == CATCH_TEST_PARAMETERS[0] and _is_iso_date(one.date)
    ]
    return max(map(dt.date.fromisoformat, days), default=None)


def _is_iso_date(text: str) -> bool:
    try:
        dt.date.fromisoformat(text)
    except ValueError:
        return False
    return True


def apply_product(machine: Machine, product: Product) -> Machine:
    """Returns the machine with the product's flow; unchanged without a catch test with this
    machine.

    Raises
    ------
    ValueError : in one line, where a test does not fit the machine."""
    test = product.find_newest_test(machine.id)
    if test is None:
        return machine
    stage = machine.flow._replace(
        grams_per_rev_mm=test.grams_per_rev_mm,
        gain_percent=0.0,
        zero_offset_g_rev=test.zero_offset_g_rev,
        fill_falloff_percent=test.fill_falloff_percent,
    )
    try:
        checked = Machine.model_validate({**dict(machine), "flow": stage})
    except ValueError as error:
        raise ValueError(
            f"product {product.id}: catch test of {test.date} with {machine.id}: "
            f"{str(error).splitlines()[-1].strip()}"
        ) from None
    said = Adopted(
        id="flow.grams_per_rev_mm",
        size=test.grams_per_rev_mm,
        low=test.low,
        high=test.high,
        unit="g per revolution and mm",
        data=test.data or product.id,
        sha256=test.sha256,
        date=test.date.isoformat(),
    )
    kept = tuple(one for one in machine.adopted if one.id not in CATCH_TEST_PARAMETERS)
    return checked.model_copy(update={"adopted": (*kept, said)})
