"""How is a plant reached through ports and bytes only? It writes a fix as NMEA, a canopy sample as
the heads' lines, and the drives as status lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Literal

from topdress.control.readings import GnssFix
from topdress.control.simulation.plant import Plant
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.canopy_heads import FIELDS_OF_PROTOCOL, HeadFields, HeadsConfig
from topdress.drivers.devices.fix_source import GnssConfig
from topdress.drivers.devices.nmea import MPS_PER_KNOT, seal_sentence
from topdress.drivers.devices.slave_board import BoardConfig
from topdress.drivers.ports import Clock, MemoryPort, Port, make_memory_pair
from topdress.drivers.virtual.board import VirtualBoard
from topdress.drivers.virtual.virtual_devices import MachineExtra

MODE_OF_QUALITY = {1: "A", 2: "D", 3: "P", 4: "R", 5: "F", 6: "E", 7: "M", 8: "S"}
# The time of a simulated fix that carries no UTC.
DEFAULT_FIRST_UTC = datetime(2026, 4, 1, 6, 0, 0, tzinfo=UTC)


def make_gnss_sentences(fix: GnssFix, talker: str = "GN") -> bytes:
    """Returns one epoch as GGA, RMC and VTG. Positions have a resolution of 1e-7 minutes (0.2 mm),
    speeds of 0.001 knots.

    Without `fix.utc` the time is `DEFAULT_FIRST_UTC` plus `fix.time_s`. Quality 0 writes no
    position and status V.
    """
    at = (
        datetime.fromisoformat(fix.utc)
        if fix.utc
        else DEFAULT_FIRST_UTC + timedelta(seconds=fix.time_s)
    )
    # Half a millisecond is added, because the time is cut to milliseconds below.
    at = (at + timedelta(microseconds=500)).astimezone(UTC)
    clock = f"{at:%H%M%S}.{at.microsecond // 1000:03d}"
    valid = fix.fix_quality > 0
    place = (
        f"{_format_minutes(fix.lat_deg, 2, 'NS')},{_format_minutes(fix.lon_deg, 3, 'EW')}"
        if valid
        else ",,,"
    )
    mode = MODE_OF_QUALITY.get(fix.fix_quality, "A") if valid else "N"
    satellites = "" if fix.satellites is None else f"{fix.satellites:02d}"
    hdop = "" if fix.hdop is None else f"{fix.hdop:.2f}"
    knots = "" if fix.speed_mps is None else f"{fix.speed_mps / MPS_PER_KNOT:.3f}"
    kmh = "" if fix.speed_mps is None else f"{fix.speed_mps * 3.6:.3f}"
    course = "" if fix.heading_deg is None else f"{fix.heading_deg % 360.0:.3f}"
    return (
        seal_sentence(
            f"{talker}GGA,{clock},{place},{fix.fix_quality},{satellites},{hdop},0.0,M,0.0,M,,"
        )
        + seal_sentence(
            f"{talker}RMC,{clock},{'A' if valid else 'V'},{place},{knots},{course},"
            f"{at:%d%m%y},,,{mode}"
        )
        + seal_sentence(f"{talker}VTG,{course},T,,M,{knots},N,{kmh},K,{mode}")
    )


def make_head_line(ndvi: float, layout: HeadFields, head: int | None = None) -> bytes:
    """Returns one sample of one head in the given layout; `head` adds the multiplexed line's
    `H<n>,`.

    The second index repeats the NDVI, and reflectances give it; other fields are 0.
    """
    fields = ["0"] * layout.fields
    for number in (layout.index_2, layout.ndvi):
        if number:
            fields[number - 1] = f"{ndvi:.3f}"
    if layout.nir:
        fields[layout.nir - 1], fields[layout.red - 1] = (
            f"{(1.0 + sign * ndvi) / 2.0:.4f}" for sign in (1.0, -1.0)
        )
    prefix = "" if head is None else f"H{head},"
    return f"{prefix}{','.join(fields)}\r\n".encode("ascii")


def _format_minutes(degrees: float, width: int, letters: str) -> str:
    """Returns an angle as `4807.0380000,N`: whole degrees, then minutes, rounded together so that
    60 minutes never appear."""
    ten_millionths = round(abs(degrees) * 60e7)
    whole, minutes = divmod(ten_millionths, 600_000_000)
    return (
        f"{whole:0{width}d}{minutes // 10_000_000:02d}.{minutes % 10_000_000:07d},"
        f"{letters[degrees < 0.0]}"
    )


# The opening of the gate at power-on on the nominal machine, mm.
INITIAL_OPENING_MM = 25.0
# Longest pause that is simulated afterwards, s; a longer pause (a suspended computer) is skipped.
MAX_CATCH_UP_S = 5.0


class VirtualMachine:
    """Steps a plant up to a given time and exchanges bytes on its ends of the ports.

    Parameters
    ----------
    plant : stepped by `plant.dt_s`; its time 0 is `start_s`.
    gnss, board : the machine's ends of those two lines.
    heads : one end for each head, or one end for all heads where the line is multiplexed.
    layout : the layout of a head's line.
    opening_mm : opening of the plant's gate at the start, mm.
    multiplexed : whether all heads use the one port in `heads`, each line preceded by its head.
    start_s : start on the clock that `advance_to` uses, s.
    extras : further devices; those that alter the command do so in their order, the last one
    decides.
    """

    def __init__(
        self,
        plant: Plant,
        gnss: Port,
        heads: Sequence[Port],
        board: Port,
        start_s: float,
        *,
        layout: HeadFields = FIELDS_OF_PROTOCOL["greenseeker"],
        multiplexed: bool = False,
        opening_mm: float = INITIAL_OPENING_MM,
        extras: Sequence[MachineExtra] = (),
    ) -> None:
        self.board = VirtualBoard(opening_mm)
        self._extras = tuple(extras)
        self._plant = plant
        self._gnss_port, self._head_ports, self._board_port = gnss, tuple(heads), board
        self._layout = layout
        self._multiplexed = multiplexed
        self._start_s = start_s
        self._steps = 0

    def advance_to(self, now_s: float) -> int:
        """Steps the plant up to `now_s` and returns the number of steps.

        Commands that have arrived act from the first of these steps on; the readings after a step
        are on their line at once.
        """
        behind_s = now_s - self._start_s - self._steps * self._plant.dt_s
        if behind_s > MAX_CATCH_UP_S:
            self._start_s += behind_s - MAX_CATCH_UP_S
        steps = 0
        while self._start_s + (self._steps + 1) * self._plant.dt_s <= now_s + 1e-6:
            self._step_plant()
            steps += 1
        return steps

    def close(self) -> None:
        """Closes the machine's ends of all lines."""
        for port in (self._gnss_port, *self._head_ports, self._board_port):
            port.close()

    def _step_plant(self) -> None:
        begin_s = self._start_s + self._steps * self._plant.dt_s
        # The order is that of a real machine: command, drives, motion, and only then new readings.
        self.board.feed_commands(self._board_port.read(), begin_s)
        command, enabled = self.board.find_set_points(begin_s)
        command = command._replace(dose=self.board.take_dose(begin_s))
        for extra in self._extras:
            command, enabled = extra.alter_command(begin_s, command, enabled)
        sensed = self._plant.advance_plant(command, enabled)
        self._steps += 1
        if sensed.gnss is not None:
            self._gnss_port.write(make_gnss_sentences(sensed.gnss))
        if sensed.ndvi is not None:
            self._write_heads(sensed.ndvi)
        self.board.turn_encoder(
            (getattr(self._plant, "truth", None) or sensed).shaft_rpm, self._plant.dt_s
        )
        self._board_port.write(self.board.make_status(sensed, begin_s))
        for extra in self._extras:
            extra.take_readings(sensed, begin_s)

    def _write_heads(self, ndvi: tuple[float, ...]) -> None:
        if self._multiplexed:
            self._head_ports[0].write(
                b"".join(
                    make_head_line(value, self._layout, head)
                    for head, value in enumerate(ndvi, start=1)
                )
            )
            return
        for port, value in zip(self._head_ports, ndvi, strict=True):
            port.write(make_head_line(value, self._layout))


def make_virtual_cab(
    plant: Plant,
    clock: Clock,
    heads: int = 6,
    *,
    protocol: str = "greenseeker",
    multiplexed: bool = False,
    board: BoardConfig | None = None,
    opening_mm: float = INITIAL_OPENING_MM,
    index: Literal["ndvi", "ndre"] = "ndvi",
    extras: Sequence[MachineExtra] = (),
) -> tuple[Cab, VirtualMachine]:
    """Returns a cab and the virtual machine that is connected to it by ports in memory.

    The caller calls `machine.advance_to(now_s)` before `cab.read_measurements(now_s)` at every
    tick.

    Parameters
    ----------
    heads : number of the plant's canopy heads.
    protocol : protocol of the heads, one of `canopy_heads.FIELDS_OF_PROTOCOL`.
    opening_mm : opening of the plant's gate at the start, mm.
    index : the head's index that determines the rate.
    extras : further devices, as for `VirtualMachine`.
    board : drive limits and wheel, where they differ from the nominal machine; its port name is not
    used.
    """
    head_names = (
        ("memory:heads",) if multiplexed else tuple(f"memory:head_{n}" for n in range(1, heads + 1))
    )
    names = ("memory:gnss", *head_names, "memory:board")
    pairs: dict[str, tuple[MemoryPort, MemoryPort]] = {
        name: make_memory_pair(name, clock) for name in names
    }
    config = CabConfig(
        gnss=GnssConfig(port="memory:gnss"),
        heads=HeadsConfig(
            protocol=protocol, ports=head_names, multiplexed=multiplexed, heads=heads, index=index
        ),
        board=(board or BoardConfig(port="")).model_copy(update={"port": "memory:board"}),
    )
    machine = VirtualMachine(
        plant,
        pairs["memory:gnss"][1],
        [pairs[name][1] for name in head_names],
        pairs["memory:board"][1],
        clock(),
        layout=FIELDS_OF_PROTOCOL[protocol],
        multiplexed=multiplexed,
        opening_mm=opening_mm,
        extras=extras,
    )
    return Cab(config, clock, lambda url, _baud, _clock: pairs[url][0]), machine
