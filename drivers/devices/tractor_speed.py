"""Which speeds does the tractor announce? The tractor's own computer or a gateway sends one ASCII
sentence.

    $PTDSP,0.50,0.0,4.5,1.2,7.0*hh

The first number is the acceleration of the tractor, m/s2. Pairs follow: seconds from now and speed
in km/h, negative backwards. The first pair, at 0.0, is the present target speed. `hh` is NMEA's
checksum. The sentence is sent at least once a second and is valid for 2 s.
"""

from __future__ import annotations

import re

from topdress.control.readings import MAX_ANNOUNCED_POINTS, AnnouncedSpeeds, is_announceable
from topdress.control.signals import N_
from topdress.drivers.devices.device import LineConfig, LineDevice
from topdress.drivers.devices.lines import ForeignSentence, LineDecoder, RejectedSentence
from topdress.drivers.devices.nmea import calc_checksum, seal_sentence

SENTENCE_HEADER = b"PTDSP,"
_SENTENCE = re.compile(rb"\$([^*$]*)\*([0-9A-Fa-f]{2})")
_NUMBER = re.compile(rb"-?\d{1,4}(\.\d{1,6})?")


class TractorConfig(LineConfig):
    """Describes the tractor's own computer, or a gateway to it, that announces the speeds that the
    tractor will reach (`$PTDSP`)."""


class TractorSpeedDecoder(LineDecoder[AnnouncedSpeeds]):
    """Decodes bytes to announced speeds. Counted as rejected: `bad_checksum`, `wrong_fields`,
    `impossible_value`, `overlong`, `garbage`; as ignored: sentences with another name."""

    longest = 1024

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[AnnouncedSpeeds]:
        found = _SENTENCE.fullmatch(sentence.strip())
        if found is None:
            raise RejectedSentence("garbage")
        body, sum_ = found.groups()
        if calc_checksum(body) != int(sum_, 16):
            raise RejectedSentence("bad_checksum")
        if not body.startswith(SENTENCE_HEADER):
            raise ForeignSentence("other_sentence")
        fields = body[len(SENTENCE_HEADER) :].split(b",")
        if (
            len(fields) % 2 == 0
            or not 3 <= len(fields) <= 1 + 2 * MAX_ANNOUNCED_POINTS
            or not all(map(_NUMBER.fullmatch, fields))
        ):
            raise RejectedSentence("wrong_fields")
        values = [float(field) for field in fields]
        announced = AnnouncedSpeeds(
            time_s,
            tuple((in_s, kmh / 3.6) for in_s, kmh in zip(values[1::2], values[2::2], strict=True)),
            values[0],
        )
        if not is_announceable(announced):
            raise RejectedSentence("impossible_value")
        return [announced]


def make_speed_sentence(announced: AnnouncedSpeeds) -> bytes:
    """Returns an announcement as bytes, for a gateway or a virtual tractor."""
    pairs = ",".join(f"{in_s:.2f},{3.6 * mps:.3f}" for in_s, mps in announced.points)
    return seal_sentence(f"PTDSP,{announced.acceleration_mps2:.2f},{pairs}")


def make_example() -> bytes:
    """Returns forty announcements of a tractor that drives faster."""
    speeds_mps = (1.2 + tick / 100.0 for tick in range(40))
    plans = (AnnouncedSpeeds(0.0, ((0.0, now_mps), (1.5, 2.0)), 0.5) for now_mps in speeds_mps)
    return b"".join(map(make_speed_sentence, plans))


DEVICE = LineDevice(
    section="tractor",
    title=N_("tractor"),
    protocol="tractor-speed/1",
    config=TractorConfig,
    make_decoder=lambda config: TractorSpeedDecoder(),
    find_measurements=lambda announced: {"speed_told": announced},
    make_record=lambda announced: {
        "acceleration_mps2": announced.acceleration_mps2,
        **{f"speed_mps_in_{in_s:g}_s": mps for in_s, mps in announced.points},
    },
    make_example=make_example,
)
