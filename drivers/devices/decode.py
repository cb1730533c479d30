"""What does a raw capture of one device contain, read through its real driver? `topdress decode`
prints the answer.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from topdress.control.readings import GnssFix
from topdress.control.signals import SIGNALS
from topdress.drivers.devices.canopy_heads import FIELDS_OF_PROTOCOL as HEAD_PROTOCOLS
from topdress.drivers.devices.canopy_heads import HeadDecoder, HeadFields, find_head_fields
from topdress.drivers.devices.capture import extract_received, is_capture
from topdress.drivers.devices.device import LineDevice, Receiver, Record
from topdress.drivers.devices.lines import Counts
from topdress.drivers.devices.registry import list_line_devices, map_receivers
from topdress.drivers.plugins import find_plugin

# A capture of bare bytes has no arrival times, so bytes are assumed to arrive at 9600 baud, the
# usual rate of a receiver, bytes/s. Only rules about seconds depend on this rate, such as when a
# receiver's clock that jumped back is trusted.
BYTES_PER_S = 960.0
# The bytes are fed in pieces of 0.1 s, as a port would deliver them.
CHUNK_BYTES = 96


def decode_capture(protocol: str, data: bytes) -> tuple[list[Record], Counts]:
    """Returns every accepted measurement of a capture under the run log's column names, and the
    counts by kind.

    Parameters
    ----------
    protocol : one of `DECODER_OF_PROTOCOL`; a head protocol followed by `-multi` means the
    multiplexed line. data : the whole capture: the bare bytes of the line, or a file of
    `drivers.devices.capture`.

    Returns
    -------
    records : one dict for each accepted epoch, sample or status line, in order; None where the
    device gave no value.
    counts : sentences or frames read, accepted, rejected by kind, ignored by kind.

    Raises
    ------
    ValueError : the protocol is unknown (the message lists the known names), or a line of the
    capture is wrong.
    """
    name = protocol.removesuffix("-multi")
    if protocol not in DECODER_OF_PROTOCOL and find_plugin("devices", name) is not None:
        data = extract_received(data) if is_capture(data) else data
        layout = find_head_fields(name)
        if layout is not None:
            return _decode_heads(layout, name != protocol, data)
        return _decode_by_plugin(name, data)
    if protocol not in DECODER_OF_PROTOCOL:
        raise ValueError(
            f"protocol {protocol!r}: allowed is one of {', '.join(sorted(DECODER_OF_PROTOCOL))}"
        )
    return DECODER_OF_PROTOCOL[protocol](extract_received(data) if is_capture(data) else data)


def _decode_all(
    decoder: Any, to_record: Callable[[Any], Record], data: bytes
) -> tuple[list[Record], Counts]:
    readings = []
    for start in range(0, len(data), CHUNK_BYTES):
        readings += decoder.feed(data[start : start + CHUNK_BYTES], start / BYTES_PER_S)
    readings += decoder.flush(len(data) / BYTES_PER_S)
    counts: Counts = decoder.counts
    return [to_record(reading) for reading in readings], counts


def _decode_by_plugin(name: str, data: bytes) -> tuple[list[Record], Counts]:
    """Returns the records and counts of a plug-in's decoder. Raises PluginFault."""
    from topdress.drivers.plugin_process import PluginDecoder

    decoder = PluginDecoder(name)
    try:
        return _decode_all(decoder, _make_fix_record, data)
    finally:
        decoder.close()


def _decode_heads(
    layout: HeadFields, multiplexed: bool, data: bytes
) -> tuple[list[Record], Counts]:
    return _decode_all(
        HeadDecoder(layout, head=None if multiplexed else 1),
        lambda sample: {f"ndvi_{sample.head}": sample.ndvi},
        data,
    )


def _make_fix_record(fix: GnssFix) -> Record:
    return {
        name: getattr(fix, name) for name in SIGNALS if name in GnssFix._fields and name != "time_s"
    }


def _decode_receiver(receiver: Receiver, data: bytes) -> tuple[list[Record], Counts]:
    return _decode_all(receiver.make_decoder(False), _make_fix_record, data)


def _decode_line_device(device: LineDevice, data: bytes) -> tuple[list[Record], Counts]:
    assert device.make_record is not None
    return _decode_all(device.make_decoder(None), device.make_record, data)


DECODER_OF_PROTOCOL: dict[str, Callable[[bytes], tuple[list[Record], Counts]]] = {
    **{one.captured_as: partial(_decode_receiver, one) for one in map_receivers().values()},
    **{
        one.section: partial(_decode_line_device, one)
        for one in list_line_devices()
        if one.make_record is not None
    },
    **{name: partial(_decode_heads, layout, False) for name, layout in HEAD_PROTOCOLS.items()},
    **{
        f"{name}-multi": partial(_decode_heads, layout, True)
        for name, layout in HEAD_PROTOCOLS.items()
    },
}
