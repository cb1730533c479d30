"""Which devices does a machine have, and where are they connected? The cab file lists them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

from pydantic import create_model, model_validator
from topdress.control.frozen_model import FrozenModel
from topdress.drivers.devices.canopy_heads import HeadsConfig
from topdress.drivers.devices.fix_source import GnssConfig
from topdress.drivers.devices.rate_module import MODULE_TIMEOUT_S, RateModuleConfig
from topdress.drivers.devices.registry import list_devices
from topdress.drivers.devices.slave_board import BoardConfig


class CabBase(FrozenModel):
    """Lists the devices of a machine and where they are plugged in; None means that a device is not
    fitted. Each device of `drivers/devices` adds its section.

    `record_only`: nothing is sent to any drive; the work of another controller is only logged and
    mapped. `virtual`: `topdress serve-machine` is at the other end of the ports instead of a
    machine. The screens state this, and a job without a boundary gets the field of its simulated
    passes.
    """

    format: Literal["topdress-cab/1"] = "topdress-cab/1"
    title: str = ""
    virtual: bool = False
    record_only: bool = False
    gnss: GnssConfig | None = None
    heads: HeadsConfig | None = None
    board: BoardConfig | None = None
    rate_module: RateModuleConfig | None = None

    @model_validator(mode="after")
    def _check_metering(self) -> Self:
        module = self.rate_module
        if module is not None and (self.board is None) == (module.fixed_opening_mm is None):
            what = (
                "missing: a machine without a board has a gate set by hand, 0 to 100 mm"
                if self.board is None
                else "given, but the board moves the gate: leave one of them out"
            )
            raise ValueError(f"rate_module.fixed_opening_mm is {what}")
        return self

    @property
    def has_work_switch(self) -> bool:
        """Whether a device of this cab reports a work switch."""
        return any(part is not None and part.work_switch for part in (self.board, self.rate_module))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about these devices that the operator must know."""
        found = []
        if self.rate_module is not None:
            found.append(
                "rate_module: the module stops its motor by itself only after "
                f"{MODULE_TIMEOUT_S:g} s without "
                "the console (a slave board after 1 s): have the hard-wired stop within reach"
            )
        if self.record_only:
            return ("record only: no drive is commanded, what the machine does is logged",)
        if self.board is None and self.rate_module is None:
            found.append("no board and no rate_module: nothing can be spread")
        if not self.has_work_switch:
            found.append(
                "no work switch is fitted: flow stops by speed, field edge and operator only"
            )
        return tuple(found)


if TYPE_CHECKING:
    CabConfig = CabBase
else:
    CabConfig = create_model(
        "CabConfig",
        __base__=CabBase,
        __module__=__name__,
        __doc__=CabBase.__doc__,
        **{one.section: (one.config | None, None) for one in list_devices()},
    )
