"""Which product is spread? The product file, independent of the machine that meters it and the
crop that gets it."""

from __future__ import annotations

import datetime as dt
from typing import Literal, Self

from pydantic import Field, model_validator
from topdress.control.frozen_model import FrozenModel


class CatchTest(FrozenModel):
    """Holds one catch test: mass of this product that a machine gave for each turn and
    millimetre of opening, weighed on a day."""

    date: dt.date
    machine: str = Field(min_length=1, description="id of the machine that it was done with")
    grams_per_rev_mm: float = Field(
        gt=0.0, le=1000.0, description="all outlets together, per turn and mm of opening"
    )
    low: float | None = Field(default=None, gt=0.0, le=1000.0, description="90 % interval")
    high: float | None = Field(default=None, gt=0.0, le=1000.0, description="90 % interval")
    zero_offset_g_rev: float = Field(
        default=0.0, ge=-1e5, le=1e5, description="g a turn at zero opening"
    )
    fill_falloff_percent: float = Field(
        default=0.0, ge=-10.0, le=60.0, description="lost at the machine's full_rpm"
    )
    rows: int | None = Field(
        default=None, ge=1, le=1_000_000, description="catches that were weighed"
    )
    data: str = Field(default="", description="the table that was fitted")
    sha256: str = Field(default="", description="of that table")

    @model_validator(mode="after")
    def _check_interval(self) -> Self:
        if (self.low is None) != (self.high is None):
            raise ValueError("low and high: allowed are both or none")
        # The interval must contain its value, otherwise numbers of two tests were mixed.
        if (
            self.low is not None
            and self.high is not None
            and not self.low <= self.grams_per_rev_mm <= self.high
        ):
            raise ValueError(
                f"grams_per_rev_mm {self.grams_per_rev_mm:g}: allowed is low {self.low:g} to high "
                f"{self.high:g}"
            )
        return self


class Product(FrozenModel):
    """Holds a product file, format "topdress-product/1"."""

    format: Literal["topdress-product/1"]
    id: str = Field(pattern=r"^[a-z][a-z0-9_]*$")
    name: str = Field(min_length=1, max_length=80, description="as the bag says it")
    note: str = Field(default="", description="where the figures come from")
    n_fraction: float = Field(ge=0.05, le=0.82, description="N in the product (eq 2)")
    density_kg_l: float | None = Field(
        default=None, ge=0.2, le=3.0, description="loose, as filled in"
    )
    size_mm: float | None = Field(
        default=None, gt=0.0, le=20.0, description="middle grain, by mass"
    )
    repose_deg: float | None = Field(
        default=None, gt=0.0, lt=90.0, description="angle of repose: how badly it flows"
    )
    catch_tests: tuple[CatchTest, ...] = Field(
        default=(), max_length=10_000, description="of any machine, in any order"
    )

    def find_newest_test(self, machine_id: str) -> CatchTest | None:
        """Returns the newest catch test with this machine; of several on one day the last in the
        file."""
        found = [test for test in self.catch_tests if test.machine == machine_id]
        # reversed() makes max() return the last of several tests on one day.
        return max(reversed(found), key=lambda test: test.date, default=None)

    def append_test(self, test: CatchTest) -> Product:
        """Returns the product with a further catch test."""
        return self.model_copy(update={"catch_tests": (*self.catch_tests, test)})
