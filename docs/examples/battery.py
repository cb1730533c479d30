"""What voltage does the battery monitor report? It sends `$PTBAT,12.61*hh` in volts."""

from __future__ import annotations

from topdress.control.readings import Reading
from topdress.control.signals import N_
from topdress.drivers.devices.device import LineConfig, LineDevice
from topdress.drivers.devices.lines import ForeignSentence, LineDecoder, RejectedSentence
from topdress.drivers.devices.nmea import calc_checksum, seal_sentence


class BatteryConfig(LineConfig):
    """Describes the battery monitor."""


class BatteryDecoder(LineDecoder[Reading]):
    """Decodes voltages. Counted as rejected: `bad_checksum`, `garbage`, `impossible_value`."""

    framed = True

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[Reading]:
        body, _, checksum = sentence.strip().partition(b"*")
        if checksum != b"%02X" % calc_checksum(body):
            raise RejectedSentence("bad_checksum")
        name, _, number = body.partition(b",")
        if name != b"PTBAT":
            raise ForeignSentence("other_sentence")
        try:
            volts = float(number)
        except ValueError:
            raise RejectedSentence("garbage") from None
        if not 0.0 <= volts <= 60.0:
            raise RejectedSentence("impossible_value")
        return [Reading(volts, time_s)]


def make_sentence(volts: float) -> bytes:
    """Returns a voltage as bytes."""
    return seal_sentence(f"PTBAT,{volts:.2f}")


def make_example() -> bytes:
    """Returns forty voltages."""
    return b"".join(make_sentence(12.0 + tick / 100.0) for tick in range(40))


DEVICE = LineDevice(
    section="battery",
    title=N_("battery monitor"),
    protocol="battery/1",
    config=BatteryConfig,
    make_decoder=lambda config: BatteryDecoder(),
    find_measurements=lambda reading: {"supply_v": reading},
    make_record=lambda reading: {"supply_v": reading.value},
    make_example=make_example,
    make_message=lambda sensed: make_sentence(sensed.supply_v),
)
