"""How does the host drive the metering shaft through a rate module on UDP? The module's unit is one
turn, so units per minute are r/min. This module opens nothing and reads no clock.

The rate module stops its own motor only after 4 s without its console, a slave board after 1 s.
"""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, model_validator
from topdress.control.frozen_model import FrozenModel
from topdress.control.readings import Reading
from topdress.control.signals import N_
from topdress.drivers.datagrams import is_loopback
from topdress.drivers.devices.board_frames import encode_valves
from topdress.drivers.devices.device import Device, OpenLine
from topdress.drivers.devices.lines import Decoder, IgnoredSentence, RejectedSentence
from topdress.drivers.devices.rate_module_frames import (
    MAX_PWM,
    MAX_RELAYS,
    MODULUS_24_BITS,
    BoardLabel,
    BoardStatus,
    FlowTarget,
    ModuleStatus,
    ModuleTrace,
    RelayStates,
    decode_heard,
    encode_relays,
    encode_target,
)

# Time without messages after which a rate module stops its own motor, s.
MODULE_TIMEOUT_S = 4.0
# UDP ports on which rate modules listen and to which they answer.
DEFAULT_MODULE_PORT, DEFAULT_CONSOLE_PORT = 28888, 29999
# Shortest interval of targets while the set-point changes, s.
MIN_TARGET_INTERVAL_S = 0.1
# Longest interval of targets, s, because the module stops after 4 s without one.
MAX_TARGET_INTERVAL_S = 0.5
# Interval of the relay datagrams without a change, s.
RELAY_INTERVAL_S = 1.0
# Time for which the relay stays on after a stop, s, because without it the module neither controls
# nor counts.
RELAY_RUN_DOWN_S = 2.0
# Time after which a module that reports no contact with this console is no drive, s.
CONTACT_TIMEOUT_S = 2.0
# A reported shaft speed above this limit is rejected, r/min.
MAX_REPORTED_SHAFT_RPM = 400.0


UdpPort = Annotated[int, Field(ge=1, le=65535)]
ControlType = Literal["valve", "combo_close", "motor", "motor_weights", "fan", "timed"]


class RateModuleConfig(FrozenModel):
    """Describes a rate module on UDP as the metering drive. Its unit is one turn of the metering
    shaft, so units per minute are r/min.

    `address`: the module's own address or the broadcast address of the subnet; None means
    192.168.1.(50 + module), the default of the modules. `listen`: this computer's own address in
    the network of the module, or 0.0.0.0 where the module answers to the whole subnet. `subnet`:
    network from which answers are accepted, such as 192.168.1.0/24; None means `address` alone.
    `fixed_opening_mm`: opening of a gate that is set by hand because the board does not move it.
    `valves`: whether the valves of the sections are wired to the relays of the module, from the
    second relay on; otherwise they are wired to the slave board.
    """

    address: str | None = None
    port: UdpPort = DEFAULT_MODULE_PORT
    listen: str = "127.0.0.1"
    subnet: str | None = None
    listen_port: UdpPort = DEFAULT_CONSOLE_PORT
    module: Annotated[int, Field(ge=0, le=15)] = 0
    sensor: Annotated[int, Field(ge=0, le=15)] = 0
    pulses_per_turn: Annotated[float, Field(ge=1, le=16777)]
    drive: ControlType = "motor"
    max_shaft_rpm: Annotated[float, Field(gt=0, le=300)] = 100.0
    fixed_opening_mm: Annotated[float, Field(gt=0, le=100)] | None = None
    work_switch: bool = False
    valves: bool = False

    @property
    def url(self) -> str:
        """URL with both addresses and the permitted senders:
        `udp://LISTEN:PORT?to=ADDRESS:PORT&from=NETWORK`."""
        senders = "" if self.subnet is None else f"&from={self.subnet}"
        return (
            f"udp://{self.listen}:{self.listen_port}?to={self.module_address}:{self.port}{senders}"
        )

    @property
    def module_address(self) -> str:
        """Address to which the datagrams are sent."""
        return self.address or f"192.168.1.{50 + self.module}"

    @model_validator(mode="after")
    def _check_senders(self) -> Self:
        if is_loopback(self.listen) != is_loopback(self.module_address):
            raise ValueError(
                f"listen {self.listen}: a module at {self.module_address} cannot be heard there: "
                "allowed is this "
                "computer's own address on the module's network, or 0.0.0.0"
            )
        if self.subnet is None and (
            self.module_address.endswith(".255") or not _is_address(self.module_address)
        ):
            raise ValueError(
                f"address {self.module_address} is not one module's: "
                "subnet is missing, from where answers are "
                "believed: allowed is a network, as 192.168.1.0/24"
            )
        if self.subnet is not None and not _is_network(self.subnet):
            raise ValueError(f"subnet {self.subnet}: allowed is a network, as 192.168.1.0/24")
        return self


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return is_loopback(text)
    return True


def _is_network(text: str) -> bool:
    try:
        ipaddress.ip_network(text)
    except ValueError:
        return False
    return True


class ModuleAddress(NamedTuple):
    """Identifies one product of one module on the subnet."""

    module: int = 0
    sensor: int = 0


class ModuleReadings(NamedTuple):
    """Holds one accepted status of the module. `shaft_rpm` is None while the module has no contact
    with this console."""

    time_s: float
    shaft_rpm: Reading | None
    # Turns of the shaft since the first status.
    turns: float
    # Duty of the motor as -FULL_PWM ... FULL_PWM, the effort of the drive.
    pwm: int
    hears_us: bool
    bin_empty: bool


class RateModule(Decoder[ModuleReadings]):
    """Decodes datagrams of one module to readings, and encodes set-points.

    Counted as rejected: `wrong_length`, `bad_checksum`, `out_of_range` (a shaft faster than 400
    r/min). Counted as ignored: `unknown_message`, `other_module` (several modules share a subnet).

    Parameters
    ----------
    pulses_per_turn : pulses of the module's encoder for one turn of the metering shaft.
    max_shaft_rpm : set-points are limited to 0 ... `max_shaft_rpm` before they are sent, r/min.
    drive : one of `rate_module_frames.CONTROL_TYPES`.
    """

    def __init__(
        self,
        address: ModuleAddress,
        pulses_per_turn: float,
        max_shaft_rpm: float,
        drive: str = "motor",
    ) -> None:
        super().__init__()
        self.label = ""
        # The newest datagram 32401.
        self.board: BoardStatus | None = None
        self.board_s: float | None = None
        # The newest datagram 32402.
        self.trace: ModuleTrace | None = None
        self._address = address
        self._pulses_per_turn = pulses_per_turn
        self._max_shaft_rpm = max_shaft_rpm
        self._drive = drive
        self._turns = 0.0
        self._quantity: float | None = None
        self._unheard_since_s: float | None = None
        self._sent: tuple[float, bool] | None = None
        self._sent_s = -math.inf
        self._relays: int | None = None
        self._relays_s = -math.inf
        self._run_until_s = -math.inf
        # The speed that the module reported last, r/min.
        self._turns_rpm = 0.0

    def feed(self, datagrams: Iterable[bytes], time_s: float) -> list[ModuleReadings]:
        """Returns the readings of the datagrams that arrived at `time_s`, oldest first."""
        return [readings for data in datagrams for readings in self._decode_and_count(data, time_s)]

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[ModuleReadings]:
        heard = decode_heard(sentence)
        if heard.module != self._address.module or (
            isinstance(heard, ModuleStatus | ModuleTrace) and heard.sensor != self._address.sensor
        ):
            raise IgnoredSentence("other_module")
        if isinstance(heard, ModuleStatus):
            if heard.units_per_min > MAX_REPORTED_SHAFT_RPM:
                raise RejectedSentence("out_of_range")
            return [self._read_status(heard, time_s)]
        if isinstance(heard, BoardLabel):
            self.label = heard.text
        elif isinstance(heard, ModuleTrace):
            self.trace = heard
        else:
            self.board, self.board_s = heard, time_s
        return []

    def make_datagrams(
        self, shaft_rpm: float | None, enabled: bool, now_s: float, valves: Sequence[bool] = ()
    ) -> list[bytes]:
        """Returns the datagrams due at `now_s`, often none; it is called every tick.

        `valves` are the valves of the sections from left to right, on the relays from the second
        on; they are closed unless `enabled`. The first relay belongs to the drive: while no relay
        is set the module neither controls nor counts.

        A changed set-point is sent at once, but at most every 0.1 s. A stop is sent at once without
        that limit, an unchanged set-point every 0.5 s. Relays are sent every second and on change.
        Without `enabled` or a set-point the module receives 0 with the master off.

        Raises
        ------
        ValueError : the set-point is not finite. Nothing is sent then; send a stop.
        """
        running = enabled and shaft_rpm is not None
        rpm = 0.0
        if shaft_rpm is not None:
            if not math.isfinite(shaft_rpm):
                raise ValueError(f"rate module: shaft_rpm {shaft_rpm}: allowed are finite numbers")
            rpm = min(max(shaft_rpm, 0.0), self._max_shaft_rpm) if running else 0.0
        if running:
            self._run_until_s = now_s + RELAY_RUN_DOWN_S
        relays = int(now_s < self._run_until_s)
        if running:
            relays |= encode_valves(valves[: MAX_RELAYS - 1]) << 1
        found = []
        if relays != self._relays or now_s - self._relays_s >= RELAY_INTERVAL_S:
            self._relays, self._relays_s = relays, now_s
            found.append(encode_relays(RelayStates(*self._address, relays)))
        if self._is_target_due((rpm, running), now_s):
            self._sent, self._sent_s = (rpm, running), now_s
            found.append(
                encode_target(
                    FlowTarget(*self._address, rpm, self._pulses_per_turn, self._drive, running)
                )
            )
        return found

    def _is_target_due(self, wanted: tuple[float, bool], now_s: float) -> bool:
        waited_s = now_s - self._sent_s
        if wanted == self._sent:
            # A shaft that still turns after a stop gets the stop again and again.
            disobeys = wanted[0] == 0.0 and self._turns_rpm > 0.0
            return waited_s >= (MIN_TARGET_INTERVAL_S if disobeys else MAX_TARGET_INTERVAL_S)
        stops = wanted[0] == 0.0 or self._sent is None or wanted[1] != self._sent[1]
        return stops or waited_s >= MIN_TARGET_INTERVAL_S

    def _read_status(self, status: ModuleStatus, time_s: float) -> ModuleReadings:
        if self._quantity is not None:
            moved = (status.quantity - self._quantity) % (MODULUS_24_BITS / 10.0)
            # A quantity that runs backwards means that the module was restarted.
            self._turns += moved if moved < MODULUS_24_BITS / 20.0 else 0.0
        self._quantity = status.quantity
        if status.hears_you:
            self._unheard_since_s = None
        elif self._unheard_since_s is None:
            self._unheard_since_s = time_s
        self._turns_rpm = status.units_per_min
        deaf = (
            self._unheard_since_s is not None
            and time_s - self._unheard_since_s >= CONTACT_TIMEOUT_S
        )
        return ModuleReadings(
            time_s,
            None if deaf else Reading(status.units_per_min, time_s),
            self._turns,
            status.pwm,
            status.hears_you,
            status.bin_empty,
        )


def open_rate_module(config: RateModuleConfig) -> Sequence[OpenLine]:
    """Returns the datagram line of a module. A gate set by hand gets the time stamp of the
    module's own readings."""
    module = RateModule(
        ModuleAddress(config.module, config.sensor),
        config.pulses_per_turn,
        config.max_shaft_rpm,
        config.drive,
    )

    def find_measurements(readings: ModuleReadings) -> Mapping[str, Any]:
        if readings.shaft_rpm is None:
            return {}
        effort = Reading(100.0 * abs(readings.pwm) / MAX_PWM, readings.time_s)
        found = {"shaft_rpm": readings.shaft_rpm, "shaft_effort": effort}
        if config.fixed_opening_mm is not None:
            found["opening_mm"] = Reading(config.fixed_opening_mm, readings.time_s)
        return found

    def find_state(now_s: float) -> Mapping[str, Any]:
        if not config.work_switch or module.board is None:
            return {}
        return {"work_switch": (module.board.work_switch, module.board_s)}

    return (
        OpenLine(
            name="rate_module",
            protocol=f"rate-module/udp (stops by itself after {MODULE_TIMEOUT_S:g} s)",
            url=config.url,
            baud=None,
            decoder=module,
            find_measurements=find_measurements,
            find_state=find_state,
        ),
    )


DEVICE = Device(
    section="rate_module",
    title=N_("rate module"),
    config=RateModuleConfig,
    open_lines=open_rate_module,
    sole=("shaft_rpm", "shaft_effort"),
    rank=4,
)
