"""A million mutated frames through every driver: does one fall over, hang, or believe what was
never said?

    python -m benchmarks fuzz_protocols --frames 1000000

Each frame is made of random values, spoilt in one way (the kinds below), and given to the
protocol's streaming decoder (crash, slowest piece) and to its frame reader. Accepted is counted
as right where it says exactly what one of the frames that went into it said, else as wrong.
What is wrong and accepted is looked at: could any reader that knows the protocol tell it from a
frame that was sent?
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from topdress.control.readings import AnnouncedSpeeds, DriveCommand, GnssFix
from topdress.drivers.board.framing import Receiver, seal_frame
from topdress.drivers.devices import (
    agopengps,
    board_frames,
    gpsd,
    lag_rig,
    point_dose,
    rate_module_frames,
)
from topdress.drivers.devices.board_frames import CommandFrame, encode_command
from topdress.drivers.devices.canopy_heads import FIELDS_OF_PROTOCOL, HeadDecoder, HeadFields
from topdress.drivers.devices.gnss import GnssDecoder
from topdress.drivers.devices.lines import IgnoredSentence, RejectedSentence
from topdress.drivers.devices.nmea import parse_sentence
from topdress.drivers.devices.rate_module_frames import (
    FlowTarget,
    ModuleStatus,
    RelayStates,
    encode_relays,
    encode_target,
)
from topdress.drivers.devices.rate_module_frames import encode_status as encode_module
from topdress.drivers.devices.slave_board import SlaveBoard
from topdress.drivers.devices.tractor_speed import TractorSpeedDecoder
from topdress.drivers.devices.tractor_speed import make_speed_sentence as plan_sentence
from topdress.drivers.ports import make_memory_pair
from topdress.drivers.virtual.board import VirtualBoard
from topdress.drivers.virtual.gpsd import VirtualGpsd
from topdress.drivers.virtual.machine import make_gnss_sentences, make_head_line
from topdress.drivers.virtual.virtual_devices import make_agopengps_frames
from verdict import exit_code

Said = tuple[Any, ...]


class Subject(NamedTuple):
    """One protocol: a frame of random values, what a frame says (None: rejected), a streaming
    decoder's `feed`."""

    make: Callable[[random.Random], bytes]
    read: Callable[[bytes], Iterable[Said]]
    stream: Callable[[], Callable[[bytes], object]]
    # why a wrong frame that is believed looks like one that was sent
    why: str


def fix(chance: random.Random) -> GnssFix:
    hour, minute, second = chance.randrange(24), chance.randrange(60), chance.randrange(60)
    utc = f"2026-04-01T{hour:02d}:{minute:02d}:{second:02d}.{chance.randrange(10)}00Z"
    return GnssFix(
        0.0,
        chance.uniform(-80, 80),
        chance.uniform(-179, 179),
        chance.choice((1, 2, 4, 5)),
        chance.randrange(4, 30),
        chance.uniform(0.5, 5.0),
        chance.uniform(0.0, 8.0),
        chance.uniform(0.0, 359.9),
        utc,
    )


def nmea_frame(chance: random.Random) -> bytes:
    sentences = make_gnss_sentences(fix(chance)).splitlines(keepends=True)
    return sentences[chance.randrange(3)]


def nmea_said(data: bytes) -> list[Said]:
    found: list[Said] = []
    for line in data.replace(b"\r", b"\n").split(b"\n"):
        for sentence in line.split(b"$")[1:]:
            try:
                found.append(parse_sentence(sentence))
            except (RejectedSentence, IgnoredSentence):
                continue
    return found


def head_frame(layout: HeadFields, multiplexed: bool, chance: random.Random) -> bytes:
    return make_head_line(
        chance.uniform(-0.2, 0.95), layout, chance.randrange(1, 7) if multiplexed else None
    )


def head_said(layout: HeadFields, multiplexed: bool, data: bytes) -> list[Said]:
    decoder = HeadDecoder(layout, head=None if multiplexed else 1)
    decoder.feed(b"#\n", 0.0)  # not the first line any more
    return list(decoder.feed(data, 0.0))


def crc_frames(decode: Callable[[bytes], Said]) -> Callable[[bytes], list[Said]]:
    def said(data: bytes) -> list[Said]:
        found = []
        for line in data.replace(b"\r", b"\n").split(b"\n"):
            for frame in line.split(b"$")[1:]:
                try:
                    found.append(decode(frame))
                except ValueError:
                    continue
        return found

    return said


def whole(chance: random.Random) -> int:
    return chance.randrange(65536)


def board_status(chance: random.Random) -> bytes:
    counts = ",".join(str(chance.randrange(2**bits)) for bits in (16, 16, 32, 32, 32))
    read = ",".join(
        f"{chance.uniform(*ends):.3f}"
        for ends in ((0, 100), (0, 60), (0, 300), (9, 15), (-9, 9), (-9, 9))
    )
    return seal_frame(f"S1,{counts},{read},{chance.choice(('', '1', '0'))},1")


def board_command(chance: random.Random) -> bytes:
    return encode_command(
        CommandFrame(
            whole(chance),
            chance.uniform(0, 100),
            chance.uniform(0, 60),
            chance.random() < 0.5,
            word=chance.choice((None, chance.randrange(2**32))),
        )
    )


def lag_line(chance: random.Random) -> bytes:
    start = chance.randrange(2**32)
    return seal_frame(
        f"L1,{whole(chance)},{whole(chance)},3,{start + 1700000},{chance.uniform(0, 100):.3f},"
        f"{chance.randrange(4096)},{start},{start + chance.randrange(2000000)},0"
    )


def dose_report(chance: random.Random) -> bytes:
    begin = chance.randrange(2**31)
    return seal_frame(
        f"E1,{whole(chance)},{whole(chance)},{chance.randrange(1, 5)},"
        f"{chance.uniform(0, 360):.3f},{begin},"
        f"{begin + chance.randrange(500000)}"
    )


def module_status(chance: random.Random) -> bytes:
    return encode_module(
        ModuleStatus(
            chance.randrange(16),
            chance.randrange(16),
            chance.uniform(0, 100),
            chance.uniform(0, 1e6),
            chance.randrange(-255, 256),
            True,
            False,
            chance.uniform(0, 1000),
        )
    )


def module_commands(chance: random.Random) -> bytes:
    if chance.random() < 0.3:
        return encode_relays(
            RelayStates(chance.randrange(16), chance.randrange(16), chance.randrange(2))
        )
    return encode_target(
        FlowTarget(
            chance.randrange(16),
            0,
            chance.uniform(0, 100),
            chance.uniform(100, 1000),
            "motor",
            chance.random() < 0.5,
        )
    )


def tractor_line(chance: random.Random) -> bytes:
    return plan_sentence(
        AnnouncedSpeeds(
            0.0,
            ((0.0, chance.uniform(-3, 5)), (chance.uniform(0.1, 9), chance.uniform(-3, 5))),
            chance.uniform(0.1, 2.0),
        )
    )


def datagrams(decode: Callable[[bytes], Said]) -> Callable[[bytes], list[Said]]:
    def said(data: bytes) -> list[Said]:
        try:
            return [decode(data)]
        except (RejectedSentence, IgnoredSentence):
            return []

    return said


def gpsd_frame(chance: random.Random) -> bytes:
    client, line = make_memory_pair("gpsd", lambda: 0.0)
    virtual = VirtualGpsd(line)
    client.write(b'?WATCH={"enable":true,"json":true}\n')
    virtual.alter_command(0.0, DriveCommand(0.0, 0.0), False)
    client.read()

    class Sensed:
        gnss = fix(chance)

    virtual.take_readings(Sensed(), 0.0)  # type: ignore[arg-type]
    return client.read().splitlines(keepends=True)[-1]  # TPV; SKY before it


def aog_frame(chance: random.Random) -> bytes:
    return make_agopengps_frames(fix(chance))[1]


NO_SUM_TCP = "JSON carries no checksum; the TCP connection that it comes on does"
NO_SUM = (
    "there is no checksum: a digit changed into a digit, a sign lost or lines run together "
    "make a line as sent"
)
CRC16 = "its CRC of 16 bits is right: noise hits it once in 65 536"
XOR = (
    "its sum of 8 bits is right: two flips in one bit column cancel, so do two equal "
    "characters lost or doubled, "
    "and noise hits it once in 256"
)
SUM = "its sum of 8 bits is right: changes that add up to 0, and noise once in 256"
# share of the frames: docs/protocol-fuzz.md and half as much again
MOST_WRONG = {NO_SUM_TCP: 0.15, NO_SUM: 0.11, CRC16: 1e-5, XOR: 4e-3, SUM: 1e-2}
FEW = 3  # of a short run


def heads(name: str, multiplexed: bool) -> Subject:
    layout = FIELDS_OF_PROTOCOL[name]
    return Subject(
        lambda chance: head_frame(layout, multiplexed, chance),
        lambda data: head_said(layout, multiplexed, data),
        lambda: _fed(HeadDecoder(layout, head=None if multiplexed else 1)),
        NO_SUM,
    )


def _fed(decoder: Any) -> Callable[[bytes], object]:
    return lambda data: decoder.feed(data, 0.0)


def by_decoder(
    make: Callable[[random.Random], bytes], decoder: Callable[[], Any], why: str
) -> Subject:
    return Subject(make, lambda data: list(decoder().feed(data, 0.0)), lambda: _fed(decoder()), why)


def _module() -> Callable[[bytes], object]:
    from topdress.drivers.devices.rate_module import ModuleAddress, RateModule

    driver = RateModule(ModuleAddress(), 360.0, 100.0)
    return lambda data: driver.feed([data], 0.0)


SUBJECTS: dict[str, Subject] = {
    "gnss (NMEA 0183)": Subject(nmea_frame, nmea_said, lambda: _fed(GnssDecoder()), XOR),
    "tractor": by_decoder(tractor_line, TractorSpeedDecoder, XOR),
    "gpsd": by_decoder(gpsd_frame, gpsd.GpsdDecoder, NO_SUM_TCP),
    "agopengps": by_decoder(aog_frame, agopengps.AgOpenGpsDecoder, SUM),
    "greenseeker": heads("greenseeker", False),
    "acs430": heads("acs430", False),
    "acs435": heads("acs435", False),
    "greenseeker-multi": heads("greenseeker", True),
    "board status": Subject(
        board_status, crc_frames(board_frames.decode_status), lambda: _fed(SlaveBoard()), CRC16
    ),
    "board command": Subject(
        board_command,
        lambda data: [tuple(fields) for fields in Receiver().feed_bytes(data)],
        lambda: _fed(VirtualBoard()),
        CRC16,
    ),
    "dose report": Subject(
        dose_report, crc_frames(point_dose.decode_dose_report), lambda: _fed(SlaveBoard()), CRC16
    ),
    "lag rig": Subject(
        lag_line, crc_frames(lag_rig.decode_rig_status), lambda: _fed(lag_rig.LagRig()), CRC16
    ),
    "rate module": Subject(module_status, datagrams(rate_module_frames.decode_heard), _module, SUM),
    "rate module, commands": Subject(
        module_commands, datagrams(rate_module_frames.decode_command), _module, SUM
    ),
}


def flip(data: bytes, other: bytes, chance: random.Random, times: int) -> bytes:
    spoilt = bytearray(data)
    for _ in range(times):
        spoilt[chance.randrange(len(spoilt))] ^= 1 << chance.randrange(8)
    return bytes(spoilt)


def splice(data: bytes, other: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data))] + other[chance.randrange(len(other)) :]


def truncate(data: bytes, other: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data))] + other


def double(data: bytes, other: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(data))
    end = min(len(data), begin + chance.randrange(1, 12))
    return data[:end] + data[begin:]


def drop(data: bytes, other: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(data))
    return data[:begin] + data[begin + chance.randrange(1, 6) :]


def noise(data: bytes, other: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(data))
    burst = chance.randbytes(chance.randrange(1, 9))
    return data[:begin] + burst + data[begin + len(burst) :]


KINDS: dict[str, Callable[[bytes, bytes, random.Random], bytes]] = {
    "1 bit": lambda d, o, c: flip(d, o, c, 1),
    "2 bits": lambda d, o, c: flip(d, o, c, 2),
    "3-6 bits": lambda d, o, c: flip(d, o, c, c.randrange(3, 7)),
    "splice": splice,
    "truncated": truncate,
    "doubled": double,
    "dropped": drop,
    "burst": noise,
    "whole twice": lambda d, o, c: d + d,
}


class Result(NamedTuple):
    frames: int
    right: int
    wrong: Counter[str]
    example: dict[str, tuple[bytes, str]]
    slowest_ms: float
    seconds: float


def fuzz(subject: Subject, frames: int, seed: int) -> Result:
    chance = random.Random(seed)
    feed = subject.stream()
    names = list(KINDS)
    right, wrong, slowest_s = 0, Counter[str](), 0.0
    example: dict[str, tuple[bytes, str]] = {}
    started_s = time.perf_counter()
    pool = [subject.make(chance) for _ in range(2000)]
    sources = {data: set(subject.read(data)) for data in pool}
    for number in range(frames):
        data, other = chance.choice(pool), chance.choice(pool)
        kind = names[number % len(names)]
        spoilt = KINDS[kind](data, other, chance)
        before_s = time.perf_counter()
        feed(spoilt)
        slowest_s = max(slowest_s, time.perf_counter() - before_s)
        for said in subject.read(spoilt):
            if said in sources[data] or said in sources[other]:
                right += 1
            else:
                wrong[kind] += 1
                example.setdefault(kind, (spoilt, str(said)[:120]))
    return Result(frames, right, wrong, example, slowest_s * 1e3, time.perf_counter() - started_s)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="protocols whose name contains this")
    parser.add_argument(
        "--examples", action="store_true", help="show one wrongly accepted frame of each kind"
    )
    asked = parser.parse_args()
    print(f"{asked.frames} mutated frames a protocol, seed {asked.seed}\n")
    print(
        "| protocol | accepted, right | accepted, wrong | share | by kind | slowest piece, "
        "ms | frames/s |"
    )
    print("|---|---|---|---|---|---|---|")
    reasons, promises = {}, {}
    for name, subject in SUBJECTS.items():
        if asked.only and asked.only not in name:
            continue
        result = fuzz(subject, asked.frames, asked.seed)
        total = result.wrong.total()
        kinds = ", ".join(f"{kind} {times}" for kind, times in result.wrong.most_common()) or "-"
        print(
            f"| {name} | {result.right} | {total} | {total / asked.frames:.2e} | {kinds} | "
            f"{result.slowest_ms:.1f} | "
            f"{result.frames / result.seconds:.0f} |",
            flush=True,
        )
        promises |= {
            f"{name}: accepted what was sent, {result.right} of {result.frames} frames": (
                result.right > 0
            ),
            f"{name}: {total} wrongly accepted, at most {MOST_WRONG[subject.why]:g} of the "
            "frames": total <= FEW + MOST_WRONG[subject.why] * result.frames,
        }
        if total:
            reasons[name] = subject.why
        if asked.examples:
            for kind, (data, said) in result.example.items():
                print(f"  {kind}: {data!r} -> {said}")
    print()
    for name, why in reasons.items():
        print(f"- {name}: {why}.")
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())
