"""Which target does another display send, and which rate does another controller apply?
Sentences on a serial line or in datagrams.

    $R,RC,1300<CR><LF>              a rate request, as displays send it to a Raven SCS console
                                    (SCS 450/460 manual,
    $R,RC,1300,0<CR><LF>            appendix 9; SCS 4000/5000, chapter 16: "the decimal point will
                                    not be sent", 130.0).
                                    The first number is taken. RateKing takes the same as its
                                    protocol "Raven 660"
    $R114-,AR,1287<CR><LF>          such a console's actual rate
    $PTDRT,130.0*hh<CR><LF>         kg/ha, with NMEA's sum: for a gateway or a script

Raven's sentences have no sum. So a target of them counts once it has come twice without another
between: one digit that was spoilt on the line is no target. RateKing believes a target for 2 s
(its manual, variable rate application).
"""

from __future__ import annotations

import re
from typing import Annotated, NamedTuple, Self

from pydantic import Field, model_validator
from topdress.control.readings import Reading
from topdress.control.signals import N_
from topdress.drivers.datagrams import parse_udp_address
from topdress.drivers.devices.device import Baud, LineConfig, LineDevice
from topdress.drivers.devices.lines import IgnoredSentence, LineDecoder, RejectedSentence
from topdress.drivers.devices.nmea import calc_checksum, seal_sentence

# Upper limit of a rate, kg/ha, the same as for the rates of a job.
MAX_RATE_KG_HA = 2000.0
_RAVEN_SENTENCE = re.compile(
    rb"\$R(?:,RC,(?P<target>\d{1,6})|[0-9A-Z-]{1,6},AR,(?P<actual>\d{1,6}))(?:,\d{0,6})*"
)
_TOPDRESS_SENTENCE = re.compile(rb"\$(PTDRT,(\d{1,4}(?:\.\d{1,3})?))\*([0-9A-Fa-f]{2})")


class RateLineConfig(LineConfig):
    """Describes another display that sends the target: `$R,RC` as for a Raven console, or `$PTDRT`.

    The line is serial, `socket://`, or the `udp://` address at which this program listens; any
    address other than loopback names the permitted sender: `?from=ADDRESS`. `unit_kg_ha` is the
    unit of the number in a Raven sentence, which has no decimal point.
    """

    baud: Baud = 9600
    unit_kg_ha: Annotated[float, Field(gt=0, le=100)] = 0.1

    @model_validator(mode="after")
    def _check_senders(self) -> Self:
        if self.port.startswith("udp://") and parse_udp_address(self.port).senders is None:
            raise ValueError(
                f"port {self.port}: anybody on that network could say how much is spread: "
                "allowed is "
                "udp://127.0.0.1:PORT, or ?from=ADDRESS with the one that is believed"
            )
        return self


class ReportedRate(NamedTuple):
    """Holds a rate in kg/ha: the target where `is_target`, otherwise the applied rate."""

    time_s: float
    rate_kg_ha: float
    is_target: bool


class RateLineDecoder(LineDecoder[ReportedRate]):
    """Decodes rates. `unit_kg_ha` is the unit of a Raven sentence's number. Counted as rejected:
    `bad_checksum`, `garbage`, `impossible_value`, `overlong`; as ignored: `said_once`, a Raven
    target that has not been repeated yet."""

    longest = 128

    def __init__(self, unit_kg_ha: float = 0.1) -> None:
        super().__init__()
        self._unit_kg_ha = unit_kg_ha
        self._before = -1.0

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[ReportedRate]:
        text = sentence.strip()
        own, raven = _TOPDRESS_SENTENCE.fullmatch(text), _RAVEN_SENTENCE.fullmatch(text)
        if own is None and raven is None:
            raise RejectedSentence("garbage")
        if own is not None and calc_checksum(own[1]) != int(own[3], 16):
            raise RejectedSentence("bad_checksum")
        is_target = own is not None or (raven is not None and raven["target"] is not None)
        rate = float(own[2]) if own is not None else 0.0
        if raven is not None:
            rate = self._unit_kg_ha * float(raven["target"] or raven["actual"])
        if rate > MAX_RATE_KG_HA:
            raise RejectedSentence("impossible_value")
        if raven is not None and is_target:
            before, self._before = self._before, rate
            if before != rate:
                raise IgnoredSentence("said_once")
        return [ReportedRate(time_s, rate, is_target)]


def make_target_sentence(rate_kg_ha: float) -> bytes:
    """Returns a target as a `$PTDRT` sentence."""
    return seal_sentence(f"PTDRT,{rate_kg_ha:.1f}")


DEVICE = LineDevice(
    section="rate_line",
    title=N_("other display"),
    protocol="rate-line/1",
    config=RateLineConfig,
    make_decoder=lambda config: RateLineDecoder(*(() if config is None else (config.unit_kg_ha,))),
    find_measurements=lambda said: {
        "rate_asked" if said.is_target else "rate_applied": Reading(said.rate_kg_ha, said.time_s)
    },
    make_record=lambda said: {
        "target_rate_kg_ha" if said.is_target else "applied_rate_kg_ha": said.rate_kg_ha
    },
    make_example=lambda: b"".join(make_target_sentence(100.0 + tick) for tick in range(40)),
)
