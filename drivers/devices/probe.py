"""Which device speaks on a line? Its bytes are given to every decoder, and the one that accepts
most identifies it.

It only listens: nothing is sent, so that probing can set no drive in motion."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from topdress.drivers.devices.agopengps import AgOpenGpsDecoder
from topdress.drivers.devices.canopy_heads import PROTOCOLS, HeadDecoder
from topdress.drivers.devices.gnss import GnssDecoder
from topdress.drivers.devices.gpsd import GpsdDecoder
from topdress.drivers.devices.lag_rig import LagRig
from topdress.drivers.devices.lines import Counts, Ignored, Rejected
from topdress.drivers.devices.rate_line import RateLineDecoder
from topdress.drivers.devices.rate_module_frames import (
    BoardLabel,
    BoardStatus,
    Status,
    Trace,
    decode_heard,
)
from topdress.drivers.devices.slave_board import SlaveBoard
from topdress.drivers.devices.tractor_speed import TractorSpeedDecoder
from topdress.drivers.ports import Clock, Port, escape_unprintable

BAUDS = (115200, 38400, 9600, 57600, 19200, 4800)  # the most usual first
LISTEN_S = 1.2  # a receiver or head at 1 Hz is heard once
MIN_MESSAGES = 2  # accepted messages that make a finding


class ProbeFinding(NamedTuple):
    """Holds the result. `protocol` empty: nothing known speaks there. `said`: the last line, or
    why the port cannot be used."""

    protocol: str = ""
    baud: int | None = None
    accepted: int = 0
    rejected: int = 0
    said: str = ""
    opened: bool = True  # False: the port could not be opened


class Decoder(Protocol):
    counts: Counts

    def feed(self, data: bytes, time_s: float) -> Sequence[object]: ...


def make_decoders() -> dict[str, Decoder]:
    """Returns a fresh decoder of every line protocol, the strictest first."""
    return {
        "slave-board/1": SlaveBoard(),
        "lag-rig/1": LagRig(),
        "agopengps": AgOpenGpsDecoder(),
        "tractor": TractorSpeedDecoder(),
        "rate_line": RateLineDecoder(),
        "nmea0183": GnssDecoder(),
        "gpsd": GpsdDecoder(),
        **{
            f"{name} (multiplexed)": HeadDecoder(layout, head=None)
            for name, layout in PROTOCOLS.items()
        },
        **{name: HeadDecoder(layout) for name, layout in PROTOCOLS.items()},
    }


def recognise_protocol(data: bytes) -> ProbeFinding:
    """Returns the protocol of bytes that were heard on a line.

    The decoder that accepts most messages is named. Where none accepts any, the one that knows
    most messages without using them is: an NMEA receiver without a fix, a gpsd that waits to be
    asked. Head layouts of equal length cannot be separated: the first one is named.
    """
    best, most = ProbeFinding(), (0, 0)
    for protocol, decoder in make_decoders().items():
        decoder.feed(data, 0.0)
        counts = decoder.counts
        understood = counts.accepted + sum(
            times
            for kind, times in counts.ignored.items()
            if kind not in ("comment", "partial_first")
        )
        enough = MIN_MESSAGES if protocol not in ("gpsd",) else 1
        if (
            understood >= enough
            and (counts.accepted, understood) > most
            and understood > counts.rejected_total
        ):
            most = (counts.accepted, understood)
            best = ProbeFinding(protocol, None, understood, counts.rejected_total)
    return best


def probe_port(
    open_at: Callable[[int], Port],
    bauds: Sequence[int],
    clock: Clock = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
    listen_s: float = LISTEN_S,
) -> ProbeFinding:
    """Listens at each baud rate in turn until something is recognised; takes at most `listen_s`
    a rate.

    `open_at` opens the port at a rate; ValueError and OSError come through."""
    said = ""
    for baud in bauds:
        port = open_at(baud)
        heard = b""
        try:
            started_s = clock()
            while clock() - started_s < listen_s:
                sleep(0.02)
                heard += port.read()
                found = recognise_protocol(heard) if heard.endswith(b"\n") else ProbeFinding()
                if found.protocol and found.accepted >= 2 * MIN_MESSAGES:
                    break
            state = port.state()
        finally:
            port.close()
        found = recognise_protocol(heard)
        last = state.format_last_lines()
        if found.protocol:
            return found._replace(baud=baud, said=last[0] if last else "")
        said = (
            f"{len(heard)} bytes that no driver understands"
            if heard
            else state.last_error or "silent"
        )
        if not state.connects:
            # it cannot be opened: not at another rate either
            return ProbeFinding(said=said, opened=False)
    return ProbeFinding(said=said)


def recognise_either(heard: Sequence[bytes]) -> ProbeFinding:
    """Identifies pieces of a line, or datagrams; the last line is part of the result."""
    found = recognise_protocol(b"".join(heard))
    if found.protocol:
        lines = re.split(rb"[\r\n]+", b"".join(heard))
        whole = [line for line in lines[:-1] if line]
        return found._replace(said=escape_unprintable(whole[-1]) if whole else "")
    modules = recognise_modules(heard)
    if modules:
        number, label = next(iter(modules.items()))
        return ProbeFinding("rate-module/udp", None, len(heard), 0, f"{number} {label}".strip())
    return found


def recognise_modules(datagrams: Sequence[bytes]) -> dict[int, str]:
    """Returns the rate modules heard, by number, with their names."""
    found: dict[int, str] = {}
    for data in datagrams:
        try:
            heard = decode_heard(data)
        except (Rejected, Ignored):
            continue
        if isinstance(heard, (Status, BoardStatus, Trace)):
            found.setdefault(heard.module, "")
        elif isinstance(heard, BoardLabel):
            found[heard.module] = heard.text
    return found
