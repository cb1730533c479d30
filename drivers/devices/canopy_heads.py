"""How are the lines of canopy heads decoded? GreenSeeker, Crop Circle ACS-430 and ACS-435 send one
ASCII line for each sample.

Six heads use six ports with one decoder each, or one multiplexed line. Every multiplexed line
begins with the number of its head, counted from 1 at the left: `H3,<the head's own line>`. See
docs/protocol-heads.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, model_validator
from topdress.control.frozen_model import FrozenModel
from topdress.control.readings import Reading
from topdress.control.signals import N_
from topdress.drivers.devices.device import Baud, Device, LineUrl, OpenLine
from topdress.drivers.devices.lines import ForeignSentence, LineDecoder, RejectedSentence
from topdress.drivers.plugins import PluginFault, find_plugin

# NDVI is a normalised difference and cannot leave -1 ... 1.
MIN_NDVI = -1.0
MAX_NDVI = 1.0
# Largest difference of NDVI from its reflectances, which heads write with two digits or more.
MAX_BANDS_ERROR = 0.02
# Largest number of canopy heads on one boom.
MAX_HEADS = 12
# Digits are limited so that no line of digits costs more than a short one.
_NUMBER = re.compile(rb"[+-]?(\d{1,9}\.?\d{0,9}|\.\d{1,9})")
_PRINTABLE = re.compile(rb"[ -~]*")
_HEAD_PREFIX = re.compile(rb"H([1-9]\d?)")


class HeadFields(NamedTuple):
    """Defines the fields of a head's line. The first field is 1; 0 means that the value is not on
    the line."""

    fields: int
    ndvi: int
    # The field of the head's second index, such as NDRE.
    index_2: int = 0
    baud: int = 38400
    # The name of the second index: `ndre`, or empty where the owner of the head chooses it.
    index_2_is: str = ""
    # Fields of the reflectances in near infrared and red, from which the head calculated NDVI.
    nir: int = 0
    red: int = 0


FIELDS_OF_PROTOCOL: dict[str, HeadFields] = {
    "greenseeker": HeadFields(fields=5, ndvi=3, index_2=4),
    "acs430": HeadFields(fields=5, ndvi=2, index_2=1, index_2_is="ndre", nir=4, red=5),
    "acs435": HeadFields(fields=8, ndvi=2, index_2=1, index_2_is="ndre"),
}


def find_head_fields(protocol: str) -> HeadFields | None:
    """Returns the fields of a built-in protocol or of a plug-in; None for an unknown name. Raises
    ValueError where a plug-in cannot be loaded."""
    if protocol in FIELDS_OF_PROTOCOL:
        return FIELDS_OF_PROTOCOL[protocol]
    found = find_plugin("devices", protocol)
    if found is None or found.is_a != HeadFields.__name__:
        return None
    fields = HeadFields(**found.values)
    if [*map(type, fields)] != [*map(type, HeadFields(1, 1))]:
        raise PluginFault("devices", protocol, f"{fields}: allowed are whole numbers, and a text")
    return fields


class HeadSample(NamedTuple):
    """Holds one accepted sample of one head."""

    # Arrival on the clock of the control loop, s.
    time_s: float
    # Number of the head, counted from 1 at the left.
    head: int
    ndvi: float
    index_2: float | None = None


class HeadDecoder(LineDecoder[HeadSample]):
    """Decodes bytes of one head, or of several heads on one line, to samples.

    Parameters
    ----------
    fields : layout of the line, one of `FIELDS_OF_PROTOCOL` or the user's own.
    head : number of the head (from 1) on this port; None where the line is multiplexed.
    heads : number of heads; a higher number on a multiplexed line is rejected.

    Raises
    ------
    ValueError : the field map refers to a field outside of the line.

    Counted as rejected: `wrong_field_count`, `not_a_number`, `out_of_range` (NDVI outside -1 to 1,
    or a second index beyond 100 either way), `unprintable` (a byte that is no ASCII text, in any
    field), `unknown_head` (a multiplexed line without `H<n>`, or with an unknown number),
    `overlong`. Counted as ignored: `partial_first` (the line that was under way when the port was
    opened), `comment` (lines beginning with #).

    The lines carry no checksum: a digit that the line changed into another digit cannot be detected
    here. The median of six heads limits its effect.
    """

    longest = 200

    def __init__(self, fields: HeadFields, head: int | None = 1, heads: int = 6) -> None:
        for what, number in (("ndvi", fields.ndvi), ("index_2", fields.index_2)):
            lowest = 1 if what == "ndvi" else 0
            if not lowest <= number <= fields.fields:
                raise ValueError(
                    f"field map: {what} is field {number}, allowed is {lowest} to {fields.fields}"
                )
        super().__init__()
        self._map = fields
        self._head = head
        self._heads = heads
        self._first = True

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[HeadSample]:
        first, self._first = self._first, False
        if sentence.startswith(b"#"):
            raise ForeignSentence("comment")
        try:
            return [self._read_sample(sentence.strip(), time_s)]
        except RejectedSentence:
            if first:
                raise ForeignSentence("partial_first") from None
            raise

    def _read_sample(self, line: bytes, time_s: float) -> HeadSample:
        head = self._head
        if head is None:
            prefix, _, line = line.partition(b",")
            match = _HEAD_PREFIX.fullmatch(prefix)
            head = int(match[1]) if match else 0
            if not 1 <= head <= self._heads:
                raise RejectedSentence("unknown_head")
        if not _PRINTABLE.fullmatch(line):
            raise RejectedSentence("unprintable")
        texts = line.split(b",")
        if len(texts) != self._map.fields:
            raise RejectedSentence("wrong_field_count")
        values = []
        for number in (self._map.ndvi, self._map.index_2):
            text = texts[number - 1].strip() if number else b"0"
            if not _NUMBER.fullmatch(text):
                raise RejectedSentence("not_a_number")
            values.append(float(text))
        ndvi, index_2 = values
        if not MIN_NDVI <= ndvi <= MAX_NDVI or abs(index_2) > 100.0:
            raise RejectedSentence("out_of_range")
        if self._map.nir:
            agrees = self._agrees_with_bands(ndvi, texts)
            self.counts.confirmed += agrees
            self.counts.foreign += not agrees
        return HeadSample(time_s, head, ndvi, index_2 if self._map.index_2 else None)

    def _agrees_with_bands(self, ndvi: float, texts: list[bytes]) -> bool:
        """Returns whether NDVI is that of the line's own reflectances. A line of another layout
        with as many fields shows it by its numbers."""
        bands = [texts[number - 1].strip() for number in (self._map.nir, self._map.red)]
        if not all(map(_NUMBER.fullmatch, bands)):
            return False
        nir, red = map(float, bands)
        total = nir + red
        return total > 0.0 and abs((nir - red) / total - ndvi) <= MAX_BANDS_ERROR


class HeadLayout(FrozenModel):
    """Assigns the fields of a head's line to NDVI and the second index. Field numbers begin at 1;
    `index_2: 0` means that the line has no second index."""

    fields: Annotated[int, Field(ge=1, le=40)]
    ndvi: Annotated[int, Field(ge=1, le=40)]
    index_2: Annotated[int, Field(ge=0, le=40)] = 0

    @model_validator(mode="after")
    def _check_field_numbers(self) -> Self:
        if max(self.ndvi, self.index_2) > self.fields:
            raise ValueError(
                f"ndvi {self.ndvi} and index_2 {self.index_2} must be at most fields {self.fields}"
            )
        return self


class HeadsConfig(FrozenModel):
    """Describes the canopy heads: one port each from left to right, or all on one
    multiplexed line."""

    protocol: str = "greenseeker"
    ports: Annotated[tuple[LineUrl, ...], Field(min_length=1, max_length=MAX_HEADS)]
    # None means the baud rate that the protocol defines.
    baud: Baud | None = None
    multiplexed: bool = False
    # The number of heads on a multiplexed line; separate ports are counted instead.
    heads: Annotated[int, Field(ge=1, le=MAX_HEADS)] = 6
    # None means the layout that the protocol defines.
    layout: HeadLayout | None = None
    # The index that determines the rate; `ndre` is the second index of the line.
    index: Literal["ndvi", "ndre"] = "ndvi"

    @model_validator(mode="after")
    def _check_heads(self) -> Self:
        if find_head_fields(self.protocol) is None and self.layout is None:
            raise ValueError(
                f"protocol {self.protocol!r}: allowed is one of {', '.join(FIELDS_OF_PROTOCOL)}, "
                "or any name together with a layout"
            )
        if self.multiplexed and len(self.ports) != 1:
            raise ValueError(f"ports: {len(self.ports)} given, a multiplexed line has 1")
        if self.index == "ndre" and (
            self.field_map.index_2_is != "ndre" if self.layout is None else self.layout.index_2 == 0
        ):
            able = ", ".join(
                name for name, known in FIELDS_OF_PROTOCOL.items() if known.index_2_is == "ndre"
            )
            raise ValueError(
                f"index ndre: heads of protocol {self.protocol} give NDVI: allowed with "
                f"{able}, or with a "
                "layout whose index_2 is NDRE"
            )
        return self

    @property
    def count(self) -> int:
        """Number of canopy heads."""
        return self.heads if self.multiplexed else len(self.ports)

    @property
    def field_map(self) -> HeadFields:
        """Fields of a line that hold NDVI and the second index."""
        if self.layout is not None:
            return HeadFields(self.layout.fields, self.layout.ndvi, self.layout.index_2)
        found = find_head_fields(self.protocol)
        assert found is not None, "_fits refuses it"
        return found


def open_heads(config: HeadsConfig) -> Sequence[OpenLine]:
    """Returns the line of each port with a canopy head, or of the port with all."""
    newest: list[Reading | None] = [None] * config.count

    def take_sample(sample: HeadSample) -> Mapping[str, Any]:
        # A head may send its second index instead of NDVI; both are limited to -1 ... 1.
        value = sample.ndvi if config.index == "ndvi" else sample.index_2
        if value is not None and abs(value) <= 1.0:
            newest[sample.head - 1] = Reading(value, sample.time_s)
        return {}

    return tuple(
        OpenLine(
            name="heads" if config.multiplexed else f"head_{place}",
            protocol=config.protocol,
            url=port,
            baud=config.baud or config.field_map.baud,
            decoder=HeadDecoder(
                config.field_map,
                head=None if config.multiplexed else place,
                heads=config.count,
            ),
            find_measurements=take_sample,
            find_state=lambda now_s: {"ndvi": tuple(newest)},
        )
        for place, port in enumerate(config.ports, start=1)
    )


DEVICE = Device(
    section="heads",
    title=N_("canopy heads"),
    config=HeadsConfig,
    open_lines=open_heads,
    rank=2,
)
