"""What the code of a plug-in does that it should not: said by its name, put aside, in nobody's
way."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
from topdress.control.readings import DriveCommand, GnssFix
from topdress.drivers import plugin_process, plugins
from topdress.drivers.cab import Cab
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.devices.canopy_heads import find_head_fields
from topdress.drivers.devices.decode import decode_capture
from topdress.drivers.devices.fix_source import GnssConfig
from topdress.drivers.files.shape_layers import read_layers
from topdress.drivers.plugins import PluginFault
from topdress.drivers.ports import PortState

from tests.command import topdress
from tests.waiting import wait_for

PACKAGE = '''
import os, re, time
from topdress.control.readings import GnssFix
from topdress.drivers.devices.canopy_heads import HeadFields
from topdress.drivers.devices.lines import Counts

class Receiver:
    def __init__(self):
        self.counts = Counts()
    def feed(self, data, time_s):
        print("what a plug-in prints is no answer")
        self.counts.accept()
        return [GnssFix(time_s, 40.0, 117.0, 4)]
    def flush(self, time_s):
        return []

class Raises(Receiver):
    def feed(self, data, time_s): return 1 / 0
class Exits(Receiver):
    def feed(self, data, time_s): raise SystemExit(0)
class Interrupts(Receiver):
    def feed(self, data, time_s): raise KeyboardInterrupt
class Dies(Receiver):
    def feed(self, data, time_s): os._exit(0)
class Sleeps(Receiver):
    def feed(self, data, time_s): time.sleep(3600)
class Locks(Receiver):
    """Never lets another thread of its program run."""
    def feed(self, data, time_s): re.match("(a+)+b", 60 * "a")
class Nonsense(Receiver):
    def feed(self, data, time_s): return [(time_s, "north", 117.0, 4)]
class WrongDate(Receiver):
    def feed(self, data, time_s): return [GnssFix(time_s, 40.0, 117.0, 4, utc="yesterday")]
class Uncounted(Receiver):
    counts = None
    def __init__(self): pass
    def feed(self, data, time_s): return []

WRONG_HEAD = HeadFields(fields="five", ndvi=2)

def exits(path): raise SystemExit(0)
def interrupts(path): raise KeyboardInterrupt
def sleeps(path): time.sleep(3600)
def locks(path): re.match("(a+)+b", 60 * "a")
def points(path): return {"type": path}
'''
DEVICES = {
    "raises": ("Raises", "ZeroDivisionError: division by zero"),
    "exits": ("Exits", "SystemExit: 0"),
    "interrupts": ("Interrupts", "KeyboardInterrupt"),
    "dies": ("Dies", "its process ended by itself"),
    "sleeps": ("Sleeps", "no answer to feed within 0.3 s"),
    "locks": ("Locks", "no answer to feed within 0.3 s"),
    "nonsense": ("Nonsense", "no list of GnssFix with counts: 'north', allowed is float"),
    "wrong_date": ("WrongDate", "no list of GnssFix with counts: utc yesterday"),
    "uncounted": ("Uncounted", "AttributeError: 'NoneType' object has no attribute 'read'"),
}
FORMATS = {
    "exits": "SystemExit: 0",
    "interrupts": "KeyboardInterrupt",
    "sleeps": "no answer to read within 0.3 s",
    "locks": "no answer to read within 0.3 s",
    "points": "which is no plain data",
}
SOUND = {"sound": "Receiver", "wrong_head": "WRONG_HEAD"}


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of packages with the one whose plug-ins do what they should not."""
    about = tmp_path / "hostile-1.0.dist-info"
    about.mkdir()
    (tmp_path / "hostile.py").write_text(PACKAGE)
    (tmp_path / "hostile_exit.py").write_text("raise SystemExit(0)\n")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: hostile\nVersion: 1.0\n")
    made = {name: made for name, (made, _) in DEVICES.items()} | SOUND
    lines = ["[topdress.devices]", *(f"{name} = hostile:{one}" for name, one in made.items())]
    lines += ["unloadable = hostile_exit:X", "[topdress.formats]"]
    lines += [f"{name} = hostile:{name}" for name in FORMATS]
    lines += ["unloadable = hostile_exit:X"]
    lines += ["[topdress.effects]", "unloadable.effect = hostile_exit:X"]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr(plugin_process, "FEED_TIMEOUT_S", 0.3)
    monkeypatch.setattr(plugin_process, "FORMAT_TIMEOUT_S", 0.3)
    forget = (plugins.find_entry_points.cache_clear, plugins._describe_once.cache_clear)
    for cleared in forget:
        cleared()
    yield tmp_path
    for cleared in forget:
        cleared()


class Line:
    """A port on which a receiver speaks; what is written to it is kept."""

    name = "line"

    def __init__(self) -> None:
        self.waiting, self.written, self.is_plugged = b"", b"", True

    def read(self) -> bytes:
        said, self.waiting = self.waiting, b""
        return said

    def write(self, data: bytes) -> None:
        self.written += data

    def plug(self, is_plugged: bool) -> None:
        self.is_plugged = is_plugged

    def state(self) -> PortState:
        return PortState(True, 1, "", 0, 0, 0, 0, None, b"")

    def close(self) -> None:
        pass


def a_cab(protocol: str) -> tuple[Cab, dict[str, Line]]:
    lines = {"gnss": Line(), "board": Line()}
    config = {name: {"port": f"socket://{name}:1"} for name in lines}
    config["gnss"]["protocol"] = protocol
    cab = Cab(
        CabConfig.model_validate(config),
        lambda: 0.0,
        lambda url, *_: lines[url.split("/")[2].split(":")[0]],
    )
    return cab, lines


@pytest.mark.parametrize("name", DEVICES)
def test_a_receiver_that_does_what_it_should_not_is_named_in_a_recording(installed, name):
    began_s = time.monotonic()
    with pytest.raises(PluginFault) as fault:
        decode_capture(name, b"one line\n")
    said = str(fault.value)
    assert said.startswith(f"plug-in {name} of hostile: ") and DEVICES[name][1] in said
    assert "\n" not in said and time.monotonic() - began_s < 30.0


@pytest.mark.parametrize("name", DEVICES)
def test_a_receiver_that_does_what_it_should_not_delays_no_tick_and_is_put_aside(installed, name):
    """Also one that lets no other thread of its program run; the board goes on being
    commanded."""
    cab, lines = a_cab(name)
    longest_s, ticks = 0.0, 0

    def ticked() -> tuple[str, ...]:
        nonlocal longest_s, ticks
        lines["gnss"].waiting, lines["board"].written = b"one line\n", b""
        began_s, ticks = time.monotonic(), ticks + 1
        put_aside = cab.read_measurements(0.05 * ticks).put_aside
        cab.send_command(0.05 * ticks, DriveCommand(0.0, 10.0), False)
        longest_s = max(longest_s, time.monotonic() - began_s)
        assert lines["board"].written
        return put_aside

    wait_for(ticked)
    assert ticked() == (f"gnss (plug-in {name})",) and longest_s < 0.2
    status = cab.find_device_line("gnss").make_status(0.0)
    assert status.last_error.startswith(f"put aside: plug-in {name} of hostile: ")
    assert DEVICES[name][1].split(":")[0] in status.last_error
    began_s = time.monotonic()
    cab.close_devices()
    assert time.monotonic() - began_s < 1.0


def test_a_sound_receiver_gives_fixes_and_counts_and_begins_anew_when_it_is_plugged(installed):
    cab, lines = a_cab("sound")

    def fix_after(now_s: float) -> GnssFix | None:
        lines["gnss"].waiting = b"one line\n"
        found = cab.read_measurements(now_s).gnss
        return found if found is not None and found.time_s >= now_s - 1.0 else None

    assert wait_for(lambda: fix_after(7.0)) is None
    assert cab.read_measurements(7.0).gnss[1:4] == (40.0, 117.0, 4)
    assert cab.find_device_line("gnss").make_status(7.0).accepted >= 1
    session = cab._devices["gnss"].decoder._session
    session._decoder._process._process.kill()
    wait_for(lambda: fix_after(9.0) or cab.read_measurements(9.0).put_aside)
    assert cab.read_measurements(9.0).put_aside == ("gnss (plug-in sound)",)
    for is_plugged in (False, True):
        cab.find_device_line("gnss").set_plugged(is_plugged)
    wait_for(lambda: fix_after(20.0))
    child = cab._devices["gnss"].decoder._session._decoder._process._process
    cab.close_devices()
    assert child.wait(2.0) is not None, "no process stays behind"


def test_a_slow_receiver_loses_the_oldest_bytes_and_holds_no_more_than_some(installed):
    session = plugin_process._DecoderSession("sleeps")
    for k in range(100):
        session.put_bytes(4096 * bytes([k]), float(k))
    assert session._waiting_bytes <= plugin_process.MAX_WAITING_BYTES
    assert session._pieces[-1][1] == 99.0
    session.end_session()


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_that_does_what_it_should_not_is_refused_by_name(installed, tmp_path, name):
    path = tmp_path / f"field.{name}"
    path.write_text("x")
    with pytest.raises(ValueError, match=f"not readable by the plug-in of .{name}: ") as fault:
        read_layers(path)
    assert FORMATS[name] in str(fault.value)


def test_what_cannot_be_loaded_ends_no_command_without_a_word(installed, tmp_path):
    wanted = "plug-in unloadable of hostile: not loaded: SystemExit: 0"
    cab, field = tmp_path / "cab.yaml", tmp_path / "field.unloadable"
    cab.write_text("format: topdress-cab/1\ngnss: {protocol: unloadable, port: COM3}\n")
    field.write_text("x")
    for words in (("check", cab), ("decode", "unloadable", field)):
        ended = topdress(*words)
        assert ended.exit_code == 2 and wanted in ended.output, words
    mapped = topdress("map", field)
    assert mapped.exit_code == 2 and "not loaded: SystemExit: 0" in mapped.output
    effect = wanted.replace("unloadable", "unloadable.effect")
    assert (
        effect in topdress("simulate", "--seconds", "1", "--effect", "unloadable.effect=1").output
    )
    assert f"note: {effect}" in topdress("effects").output


def test_values_of_the_wrong_kind_are_refused_by_name(installed):
    with pytest.raises(PluginFault, match="plug-in wrong_head of hostile: "):
        find_head_fields("wrong_head")
    with pytest.raises(ValueError, match="allowed is one of agopengps, nmea0183, gpsd"):
        GnssConfig(protocol="wrong_head", port="COM3")
