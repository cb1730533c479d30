"""Which device speaks on a line? Every decoder gets the bytes, and the decoder that recognises most
messages as its own identifies the device.

A probe only listens: nothing is sent, so that probing can set no drive in motion.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from topdress.drivers.devices.canopy_heads import FIELDS_OF_PROTOCOL, HeadDecoder
from topdress.drivers.devices.lines import IgnoredSentence, RejectedSentence
from topdress.drivers.devices.rate_module_frames import (
    BoardLabel,
    BoardStatus,
    ModuleStatus,
    ModuleTrace,
    decode_heard,
)
from topdress.drivers.devices.registry import list_line_devices, map_receivers
from topdress.drivers.ports import Clock, Port, escape_unprintable

# Baud rates in the order of how common they are.
PROBE_BAUD_RATES = (115200, 38400, 9600, 57600, 19200, 4800)
# Listening time for each rate, s: a device with 1 Hz sends at least one message.
PROBE_LISTEN_S = 1.2
# Number of messages after which a probe stops listening.
ENOUGH_MESSAGES = 4


class ProbeFinding(NamedTuple):
    """Holds the result. An empty `protocol` means that no known device speaks there. `detail` is
    the last line, or the reason why the port cannot be used."""

    protocol: str = ""
    baud: int | None = None
    accepted: int = 0
    rejected: int = 0
    detail: str = ""
    # False means that the port could not be opened.
    opened: bool = True


def make_decoders() -> dict[str, Any]:
    """Returns a new decoder for every line protocol, in any order."""
    return {
        **{name: one.make_decoder(True) for name, one in map_receivers().items()},
        **{one.heard_as or one.section: one.make_decoder(None) for one in list_line_devices()},
        **{
            f"{name} (multiplexed)": HeadDecoder(layout, head=None)
            for name, layout in FIELDS_OF_PROTOCOL.items()
        },
        **{name: HeadDecoder(layout) for name, layout in FIELDS_OF_PROTOCOL.items()},
    }


def recognise_protocol(data: bytes) -> ProbeFinding:
    """Returns the protocol of the bytes received on a line.

    The protocol of most sentences is named, used or not: a receiver without a fix and an idle gpsd
    have a name too. Sentences that another device may have sent do not count. Of two head layouts
    with as many fields, the layout is named whose numbers agree with each other.
    """
    best, most = ProbeFinding(), (0, 0, "")
    for protocol, decoder in make_decoders().items():
        decoder.feed(data, 0.0)
        counts = decoder.counts
        recognised, rejected = counts.recognised_total, counts.rejected_total
        rank = recognised, counts.confirmed, protocol
        if recognised >= max(decoder.min_recognised, rejected + 1) and rank > most:
            best, most = ProbeFinding(protocol, None, recognised, rejected), rank
    return best


def probe_port(
    open_at: Callable[[int], Port],
    bauds: Sequence[int],
    clock: Clock = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
    listen_s: float = PROBE_LISTEN_S,
) -> ProbeFinding:
    """Listens at each baud rate in turn until a device is recognised; takes at most `listen_s`
    seconds for each rate.

    `open_at` opens the port at a rate; its ValueError and OSError are raised to the caller.
    """
    detail = ""
    for baud in bauds:
        port = open_at(baud)
        heard = b""
        try:
            started_s = clock()
            while clock() - started_s < listen_s:
                sleep(0.02)
                heard += port.read()
                found = recognise_protocol(heard) if heard.endswith(b"\n") else ProbeFinding()
                if found.protocol and found.accepted >= ENOUGH_MESSAGES:
                    break
            state = port.state()
        finally:
            port.close()
        found = recognise_protocol(heard)
        last = state.format_last_lines()
        if found.protocol:
            return found._replace(baud=baud, detail=last[0] if last else "")
        detail = (
            f"{len(heard)} bytes that no driver understands"
            if heard
            else state.last_error or "silent"
        )
        if not state.connects:
            # A port that cannot be opened at this rate cannot be opened at another rate.
            return ProbeFinding(detail=detail, opened=False)
    return ProbeFinding(detail=detail)


def recognise_either(heard: Sequence[bytes]) -> ProbeFinding:
    """Returns the finding for pieces of a line or for datagrams, with the last line as `detail`."""
    found = recognise_protocol(b"".join(heard))
    if found.protocol:
        lines = re.split(rb"[\r\n]+", b"".join(heard))
        whole = [line for line in lines[:-1] if line]
        return found._replace(detail=escape_unprintable(whole[-1]) if whole else "")
    modules = recognise_modules(heard)
    if modules:
        number, label = next(iter(modules.items()))
        return ProbeFinding("rate-module/udp", None, len(heard), 0, f"{number} {label}".strip())
    return found


def recognise_modules(datagrams: Sequence[bytes]) -> dict[int, str]:
    """Returns the names of the rate modules that sent datagrams, by module number."""
    found: dict[int, str] = {}
    for data in datagrams:
        try:
            heard = decode_heard(data)
        except (RejectedSentence, IgnoredSentence):
            continue
        if isinstance(heard, (ModuleStatus, BoardStatus, ModuleTrace)):
            found.setdefault(heard.module, "")
        elif isinstance(heard, BoardLabel):
            found[heard.module] = heard.text
    return found
