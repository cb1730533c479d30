"""Scenarios for the boards' programs with a pin layer that is a small machine. Run by CPython
and by MicroPython: only what both have is used. Each gives plain lists and numbers."""

from drivers.board.board_sensors import Hx711LoadCell, Lis3dhInclinometer, UsbLine
from drivers.board.framing import seal_frame
from drivers.board.lag_rig import RigPins, RigProgram, RigSettings
from drivers.board.slave import BoardSettings, Pins, SlaveProgram

MS = 1000


class Machine(Pins):
    """A motor with a time constant behind its duty, a gate behind its steps, a wheel; bytes in
    lists."""

    def __init__(
        self, sensor=True, start_mm=25.0, rpm_per_duty=125.0, time_constant_s=0.1, words=()
    ):
        self.now_us = 0
        self.sent = []
        self.inbox = b""
        self.on = False
        self.value = 0.0
        self.rpm = 0.0
        self.turns = 0.0
        self.true_mm = start_mm
        self.gate_count = 0
        self.dose_count = 0
        self.sensor = sensor
        self.held_rpm = None  # somebody lets the shaft turn no faster
        self.fault = False
        self.loses_steps = False
        self.rpm_per_duty, self.time_constant_s = rpm_per_duty, time_constant_s
        self.valve_mask = -1  # as the pins were told
        self.valve_switches = None  # what they tell; None: there are none
        self.effort = None  # of the shaft
        self.words = words  # one for each renewal; none: a board without

    def pass_time(self, us):
        self.now_us += us
        aim = self.value * self.rpm_per_duty if self.on else 0.0
        self.rpm += (aim - self.rpm) * us * 1e-6 / self.time_constant_s
        if self.held_rpm is not None:
            self.rpm = min(self.rpm, self.held_rpm)
        self.turns += self.rpm / 60.0 * us * 1e-6

    def read(self):
        data, self.inbox = self.inbox, b""
        return data

    def write(self, data):
        self.sent.append(data)

    def enable(self, on):
        self.on = on

    def duty(self, value):
        self.value = value

    def shaft_counts(self):
        return int(self.turns * 2400.0)

    def gate_steps(self, steps):
        self.gate_count += steps
        if not self.loses_steps:
            self.true_mm += steps / 100.0

    def dose_steps(self, steps):
        self.dose_count += steps

    def opening_mm(self):
        return self.true_mm if self.sensor else None

    def at_home(self):
        return self.true_mm <= 0.0

    def driver_fault(self):
        return self.fault

    def wheel(self):
        return self.now_us // 125000, self.now_us // 125000 * 125000

    def supply_v(self):
        return 13.5

    def shaft_effort(self):
        return self.effort

    def valves(self, mask):
        self.valve_mask = mask

    def valves_open(self):
        return self.valve_switches

    def chance(self):
        return self.words.pop(0) if self.words else None


class Bench:
    """Board and machine on one clock; the host speaks when it is told to."""

    def __init__(self, settings=None, **machine):
        self.machine = Machine(**machine)
        self.board = SlaveProgram(self.machine, settings or BoardSettings())
        self.seq = 0

    def say(self, payload):
        self.machine.inbox += seal_frame(payload)

    def target(self, rpm, mm, enable):
        self.say(f"T1,{self.seq},{rpm:.3f},{mm:.3f},{enable}")
        self.seq = (self.seq + 1) % 65536

    def run(self, seconds, rpm=0.0, mm=25.0, enable=None, look=None):
        """Ticks of a millisecond; a command every 50 ms unless `enable` is None."""
        for tick in range(int(seconds * 1000)):
            if enable is not None and tick % 50 == 0:
                self.target(rpm, mm, enable)
            self.machine.pass_time(MS)
            self.board.run_round(self.machine.now_us)
            if look is not None:
                look(self)

    def flags(self):
        lines = [line for line in self.machine.sent if line.startswith(b"$S1")]
        return int(lines[-1].split(b"*")[0].split(b",")[-1])


def safe_stop():
    """When the host falls silent: ms until the motor's enable line falls; then whether it
    starts again by itself."""
    bench = Bench()
    bench.run(0.2, 0, 25, 0)
    bench.run(2.0, 60, 30, 1)
    rpm_before = round(bench.machine.rpm)
    last_ms = bench.machine.now_us // MS - 49  # the last command of that stretch
    stopped = []

    def look(b):
        if not b.machine.on and not stopped:
            stopped.append(b.machine.now_us // MS - last_ms)

    bench.run(3.0, look=look)
    flags = bench.flags()
    bench.run(1.0, 60, 30, 1)
    restarted = bench.machine.on
    bench.run(0.1, 0, 30, 0)
    bench.run(1.0, 60, 30, 1)
    return [
        rpm_before,
        stopped,
        flags,
        restarted,
        bench.machine.on,
        round(bench.machine.true_mm, 1),
    ]


def power_on():
    """Without a command, then with enable 1 only: enabled, rpm, gate moved."""
    bench = Bench()
    bench.run(0.5)
    bench.run(0.5, 60, 40, 1)
    return [bench.machine.on, round(bench.machine.rpm), bench.machine.gate_count]


def stop_at_once():
    """Ms from the frame with enable 0 to the enable line and to duty 0; the gate keeps going to
    its set-point."""
    bench = Bench()
    bench.run(0.2, 0, 25, 0)
    bench.run(1.0, 60, 25, 1)
    bench.run(0.1, 60, 40, 1)
    bench.target(0, 10, 0)
    bench.run(0.002)
    first = [bench.machine.on, bench.machine.value]
    bench.run(0.9)
    first.append(round(bench.machine.true_mm, 1))
    return first


def driver_fault():
    bench = Bench()
    bench.run(0.2, 0, 25, 0)
    bench.run(1.0, 60, 25, 1)
    bench.machine.fault = True
    bench.run(0.1, 60, 25, 1)
    return [bench.machine.on, bench.machine.value, bench.flags() & 4]


def valves():
    """The pins' mask: at power-on, before enable 0, at work, after a wrong mask, 0.9 and 1.1 s
    after the host's last word, and after a T1; and what a board without valves counts of T2."""
    settings = BoardSettings()
    settings.valves = 3
    bench = Bench(settings)
    masks = [bench.machine.valve_mask]

    def say(enable, mask, name="T2"):
        tail = f",{mask}" if name == "T2" else ""
        bench.say(f"{name},{bench.seq},50.0,25.0,{enable}{tail}")
        bench.seq += 1
        bench.run(0.01)
        masks.append(bench.machine.valve_mask)

    say(1, 5)
    say(0, 5)
    say(1, 5)
    say(1, 8)
    bench.run(0.88)
    masks.append(bench.machine.valve_mask)
    bench.run(0.2)
    masks.append(bench.machine.valve_mask)
    say(0, 0)
    say(1, 7)
    say(1, 0, "T1")
    plain = Bench()
    plain.say("T2,0,50.0,25.0,0,5")
    plain.run(0.01)
    return [masks, plain.board.receiver.rejected.get("unknown_frame", 0)]


def valve_switches():
    """Name and last fields of the newest status frame: of a board without switches, of one
    whose valves 1 and 3 are open, of one whose valves are all closed; of one without that
    measures how hard the shaft works."""
    bench, found = Bench(), []
    for bench.machine.valve_switches, bench.machine.effort in (
        (None, None),
        (5, None),
        (0, None),
        (None, 41.5),
    ):
        bench.run(0.1)
        fields = bench.machine.sent[-1].split(b"*")[0].split(b",")
        found.append([fields[0].decode(), len(fields), b",".join(fields[13:]).decode()])
    return found


def bad_frames():
    """Counts by kind after a list of wrong frames, and the speed still obeyed."""
    bench = Bench()
    bench.run(0.2, 0, 25, 0)
    bench.run(1.0, 50, 25, 1)
    good = seal_frame(f"T1,{bench.seq},90.000,25.000,1")
    wrong = [
        good.replace(b"90", b"99"),
        good[:10] + b"\r\n",
        seal_frame("T1,200,90.0,25.0"),
        seal_frame("T1,200,900.0,25.0,1"),
        seal_frame("T1,200,nan,25.0,1"),
        seal_frame("T1,200,1e1,25.0,1"),
        seal_frame("T1,200,9.,25.0,1"),
        seal_frame("T1,200,-1.0,25.0,1"),
        seal_frame("T1,70000,90.0,25.0,1"),
        seal_frame("T1,200,90.0,25.0,2"),
        seal_frame("T9,200,90.0,25.0,1"),
        seal_frame(f"T1,{bench.seq - 1},90.000,25.000,1"),
        b"x" * 300 + b"\r\n",
        b"\xff\xfe$\x00*\x80\r\n",
        b"$$$***\r\n",
    ]
    bench.machine.inbox += b"".join(wrong)
    bench.run(0.3)
    counts = sorted([kind, times] for kind, times in bench.board.receiver.rejected.items())
    return [counts, round(bench.board._wanted_rpm)]


class Orders:
    """A bench at which every order is followed by a look: motor enabled, flags 2, 32 and 64,
    the kind last rejected."""

    def __init__(self, **machine):
        self.bench = Bench(**machine)
        self.found = []

    def give(self, payload, seconds=0.03):
        before = dict(self.bench.board.receiver.rejected)
        if payload:
            self.bench.say(payload)
        self.bench.run(seconds)
        after = self.bench.board.receiver.rejected
        kinds = [kind for kind in sorted(after) if after[kind] != before.get(kind, 0)]
        self.found.append([self.bench.machine.on, self.bench.flags() & 98])
        self.found[-1].extend(kinds)

    def words_said(self):
        return [
            int(line.split(b"*")[0].split(b",")[2])
            for line in self.bench.machine.sent
            if line.startswith(b"$W1")
        ]


def orders_with_a_word(word=0xFEDCBA98, later=7):
    """Asked for its word; made ready and turned; doubled, late, old, foreign; silent; the old
    word again."""
    it = Orders(words=[word, later])
    for payload in (
        "T1,9,0.0,25.0,0",
        "A1",
        f"T3,4000000000,0.0,25.0,0,,{word}",
        f"T3,4000000020,60.0,25.0,1,,{word}",
        f"T3,4000000020,90.0,25.0,1,,{word}",
        f"T3,4000000005,90.0,25.0,1,,{word}",
        f"T3,4000000004,90.0,25.0,1,,{word}",
        f"T3,4000000021,60.0,25.0,1,,{word}",
        f"T3,4000000022,0.0,25.0,0,,{word}",
        f"T3,4000000023,60.0,25.0,1,,{word}",
        f"T3,4000000024,60.0,25.0,1,,{later}",
        f"T3,4000000025,0.0,25.0,0,,{word}",
        f"T3,4000000026,60.0,25.0,1,,{word}",
        "T1,10300,60.0,25.0,1",
        f"T3,4000000027,0.0,25.0,0,,{word}",
        f"T3,4000000028,0.0,25.0,1,,{word}",
        "D1,10400,0,90.0,60.0",
        f"T3,4000000029,0.0,25.0,0,,{word}",
        f"T3,4000000030,0.0,25.0,1,5,{word}",
        f"T3,4000000031,0.0,25.0,1,{word}",
        f"D3,4000000032,0,90.0,60.0,{word}",
    ):
        it.give(payload)
    it.give("", 1.1)
    for payload in (
        f"T3,4000000040,0.0,25.0,0,,{word}",
        f"T3,4000000041,60.0,25.0,1,,{word}",
        "A1",
        f"T3,0,0.0,25.0,0,,{later}",
        f"T3,1,60.0,25.0,1,,{later}",
    ):
        it.give(payload)
    return [it.found, it.words_said()]


def orders_without_a_word(words=(), words_only=False):
    """Of a host that knows none: made ready and turned over the wrap of its numbers; the line
    doubles, and plays back what is older by 15, 16 and half the circle; ready again; asked for
    a word that it may not have."""
    settings = BoardSettings()
    settings.words_only = words_only
    it = Orders(settings=settings, words=list(words))
    for seq, enable in (
        (65530, 0),
        (65535, 1),
        (3, 1),
        (3, 1),
        (65524, 1),
        (65523, 1),
        (4, 1),
        (5, 0),
        (6, 1),
        (6 + 32769, 1),
        (7, 0),
        (7 + 32768, 1),
    ):
        it.give(f"T1,{seq},60.0,25.0,{enable}")
    it.give("A1")
    return [it.found, it.words_said()]


def limits():
    """Set-points beyond what is screwed on are cut."""
    bench = Bench()
    bench.run(0.2, 0, 25, 0)
    bench.run(4.0, 300, 100, 1)
    return [round(bench.machine.rpm), round(bench.machine.true_mm, 1)]


def shaft_step(held_rpm=None, rpm_per_duty=125.0):
    """10 to 90 % rise time in ms, overshoot and steady error in r/min, of a step from 20 to 70
    r/min; `held_rpm`: the shaft is held at that speed for 2 s after the step and then let go
    (anti-windup)."""
    bench = Bench(rpm_per_duty=rpm_per_duty)
    bench.run(0.2, 0, 25, 0)
    bench.run(2.0, 20, 25, 1)
    if held_rpm is not None:
        bench.machine.held_rpm = held_rpm
        bench.run(2.0, 70, 25, 1)
        bench.machine.held_rpm = None
    seen = []
    bench.run(4.0, 70, 25, 1, look=lambda b: seen.append(b.machine.rpm))
    low = next((ms for ms, rpm in enumerate(seen) if rpm >= 25.0), -1)
    high = next((ms for ms, rpm in enumerate(seen) if rpm >= 65.0), -1)
    steady = sum(seen[-500:]) / 500.0 - 70.0
    return [high - low, round(max(seen) - 70.0, 2), round(steady, 2)]


def gate_moves(sensor=True):
    """Places reached and steps put out for a list of openings; without a sensor after homing."""
    bench = Bench(sensor=sensor, start_mm=12.0)
    bench.run(0.2, 0, 12, 0)
    found = []
    if not sensor:
        bench.run(0.1, 50, 25, 1)
        found.append([bench.flags() & 16, round(bench.machine.value, 3)])
        bench.run(3.0, 0, 0.5, 1)
        found.append([bench.flags() & 16, round(bench.machine.true_mm, 2)])
    for mm in (25.0, 40.0, 10.0, 10.1):
        before = bench.machine.gate_count
        bench.run(2.5, 0, mm, 1)
        found.append([round(bench.machine.true_mm, 3), bench.machine.gate_count - before])
    return found


def gate_step():
    """10 to 90 % rise time in ms, overshoot in mm, of a step from 25 to 35 mm."""
    bench = Bench()
    bench.run(0.2, 0, 25, 0)
    bench.run(0.5, 0, 25, 1)
    seen = []
    bench.run(2.0, 0, 35, 1, look=lambda b: seen.append(b.machine.true_mm))
    low = next(ms for ms, mm in enumerate(seen) if mm >= 26.0)
    high = next(ms for ms, mm in enumerate(seen) if mm >= 34.0)
    return [high - low, round(max(seen) - 35.0, 3), round(seen[-1] - 35.0, 3)]


def lost_steps():
    """The gate loses steps for a while: flagged, and made good once it can move again."""
    bench = Bench()
    bench.run(0.2, 0, 25, 0)
    bench.run(0.5, 0, 25, 1)
    bench.machine.loses_steps = True
    bench.run(1.0, 0, 40, 1)
    bench.machine.loses_steps = False
    bench.run(3.0, 0, 40, 1)
    flagged = bench.flags() & 8
    bench.run(0.1, 0, 40, 0)
    return [flagged, round(bench.machine.true_mm, 1), bench.flags() & 8]


def doses():
    """Steps of a hundred doses of 120 degrees; then one that is cut off by a stop; one asked
    for while stopped."""
    bench = Bench()
    bench.run(0.2, 0, 25, 0)
    bench.run(0.2, 0, 25, 1)
    steps = []
    for dose in range(100):
        before = bench.machine.dose_count
        bench.say(f"D1,{bench.seq},{dose},120.000,99.800")
        bench.seq += 1
        bench.run(0.3, 0, 25, 1)
        steps.append(bench.machine.dose_count - before)
    reports = [
        line.split(b"*")[0].split(b",")[2:]
        for line in bench.machine.sent
        if line.startswith(b"$E1")
    ]
    last = [report for report in reports if report[0] == b"99"][-1]
    took_ms = (int(last[4]) - int(last[3])) // MS
    before = bench.machine.dose_count
    bench.say(f"D1,{bench.seq},200,360.000,60.000")
    bench.seq += 1
    bench.run(0.1, 0, 25, 1)
    bench.run(0.2, 0, 25, 0)
    cut = bench.machine.dose_count - before
    bench.say(f"D1,{bench.seq},201,360.000,60.000")
    bench.seq += 1
    bench.run(0.1, 0, 25, 0)
    reports = [
        line.split(b"*")[0].split(b",")[2:4]
        for line in bench.machine.sent
        if line.startswith(b"$E1")
    ]
    states = [int(state) for dose, state in reports if dose == b"200"]
    refused = [int(state) for dose, state in reports if dose == b"201"]
    return [
        sum(steps),
        min(steps),
        max(steps),
        int(last[1]),
        took_ms,
        cut,
        states[-1],
        refused[-1],
        bench.machine.dose_count - before - cut,
    ]


def stepped(counts_per_turn=0.0):
    settings = BoardSettings()
    settings.shaft_drive, settings.counts_per_turn = "stepper", counts_per_turn
    return Bench(settings)


def metering_stepper():
    """Steps in a second at 60 r/min, the most by which steps/s grew within 0.1 s (steps/s^2),
    the r/min said, the most duty; then the steps in the second after each way to stop, and
    whether the drives are enabled: set-point 0, enable 0, a driver's fault, the last frame 1 s
    ago."""
    bench = stepped()
    counted, duties = [0], []

    def look(b):
        counted.append(b.machine.dose_count)
        duties.append(b.machine.value)

    bench.run(0.2, 0, 25, 0)
    bench.run(2.0, 60, 25, 1, look=look)
    tenths = [counted[k + 100] - counted[k] for k in range(0, 1900, 100)]
    rises = [tenths[k + 1] - tenths[k] for k in range(18)]
    said_rpm = bench.machine.sent[-1].split(b",")[6].decode()
    found = [counted[-1] - counted[-1001], max(rises) * 100, said_rpm, max(duties)]
    for rpm, enable, fault, wait_s in (
        (0, 1, False, 0.0),
        (60, 0, False, 0.0),
        (60, 1, True, 0.0),
        (60, None, False, 0.951),
    ):
        bench.machine.fault = False
        bench.run(0.2, 0, 25, 0)
        bench.run(1.0, 60, 25, 1)
        bench.run(wait_s)
        bench.machine.fault, before = fault, bench.machine.dose_count
        bench.run(1.0, rpm, 25, enable)
        found.append([bench.machine.dose_count - before, bench.machine.on])
    return found


def stepper_falls_out_of_step():
    """A stepper with an encoder at 80 r/min, held from the second to the fourth second: steps
    put out in each half second and the r/min said at its end."""
    bench = stepped(2400.0)
    machine, found, held = bench.machine, [], [False, 0]

    def follow(b):
        machine.turns += 0.0 if held[0] else (machine.dose_count - held[1]) / 400.0
        held[1] = machine.dose_count

    bench.run(0.2, 0, 25, 0)
    for half in range(10):
        held[0], before = 4 <= half < 8, machine.dose_count
        bench.run(0.5, 80, 25, 1, look=follow)
        found.append([machine.dose_count - before, round(bench.board.shaft_rpm)])
    return found


def turned():
    """What is answered to A2 by a board with a DC motor, with a stepper, with both encoder and
    stepper, before any target and after 2 s at 60 r/min; whether it obeys anything after the
    question alone."""
    found = []
    for bench in (Bench(), stepped(), stepped(2400.0)):
        for _ in range(2):
            bench.say("A2")
            bench.run(0.03)
            line = [one for one in bench.machine.sent if one.startswith(b"$C1")][-1]
            found.append(line.split(b"*")[0].decode().split(",")[2:])
            found[-1].append(bench.machine.on)
            bench.run(0.2, 0, 25, 0)
            bench.run(2.0, 60, 25, 1)
            bench.run(0.5, 0, 25, 0)
    return found


def own_settings():
    """What the lines of a maker's board_settings.py do, and why they are refused."""
    found = []
    for line in (
        "counts_per_turn, link = 1198, 'usb'",
        "counts_per_tern = 1.0",
        "link = 'wifi'",
        "counts_per_turn = '1200'",
        "counts_per_turn = 0.0",
        "words_only = 1",
        "take = 1",
        "stepper_steps_s2 = 1e9",
        "shaft_drive, counts_per_turn = 'stepper', 0.0",
        "shaft_drive, dose_steps_per_turn = 'stepper', 6400.0",
    ):
        settings, names = BoardSettings(), {}
        exec("class Own:\n    " + line, names)
        try:
            settings.take_settings(names["Own"])
            found.append([settings.counts_per_turn, settings.link, settings.shaft_drive])
        except ValueError as why:
            found.append(str(why))
    return found


class FakeUsb:
    """Both streams of the prompt: `inbox` a byte at a time, `room` for so many bytes more."""

    def __init__(self):
        self.inbox, self.outbox, self.room, self.asked_for = b"", b"", 0, []

    def read(self, count):
        self.asked_for.append(count)
        data, self.inbox = self.inbox[:count], self.inbox[count:]
        return data

    def write(self, data):
        self.room -= len(data)
        self.outbox += data


def usb_line():
    """Bytes read in rounds; written to a host that reads nothing, then some, then all: nothing
    waits, whole frames are dropped."""
    usb = FakeUsb()
    line = UsbLine(usb, usb, lambda: bool(usb.inbox), lambda: usb.room > 0)
    usb.inbox = b"x" * 100
    found = [len(line.read()), len(line.read()), len(line.read()), max(usb.asked_for)]
    for number in range(200):
        line.write(seal_frame(f"S1,{number},0"))
        line.read()
    found.append(len(usb.outbox))
    for room in (10, 10000):
        usb.room = room
        for _ in range(20):
            line.read()
        found.append(len(usb.outbox))
    frames = usb.outbox.split(b"\r\n")
    found += [usb.room > 0, frames[0].decode(), len(frames), frames[-1].decode()]
    line.write(b"after")
    line.read()
    found.append(usb.outbox[-5:].decode())
    return found


class Rig(RigPins):
    def __init__(self):
        self.sent, self.inbox = [], b""
        self.counts, self.newest_us, self.before_us = 0, 0, 0
        self.value = 500

    def read(self):
        data, self.inbox = self.inbox, b""
        return data

    def write(self, data):
        self.sent.append(data)

    def encoder(self):
        return self.counts, self.newest_us, self.before_us

    def plate(self):
        return self.value


def lag_rig(early_granule=False):
    """State, start and landing in ms of one run: the shaft creeps at 1 r/min from 100 ms, turns
    at 20 r/min from 400 ms on; noise on the plate; a granule at 1900 ms (and one at 200 ms,
    before the start)."""
    pins = Rig()
    rig = RigProgram(pins, RigSettings())
    turned, chance = 0.0, 7
    for ms in range(3000):
        if ms == 50:
            pins.inbox = seal_frame("R1,1,42,1")
        rpm = 0.0 if ms < 100 else 1.0 if ms < 400 else 20.0
        turned += rpm / 60.0 * 0.001 * 1000.0
        while pins.counts < int(turned):
            pins.counts += 1
            pins.before_us, pins.newest_us = pins.newest_us, ms * MS
        chance = (chance * 1103515245 + 12345) & 0x7FFFFFFF
        pins.value = 500 + (chance >> 16) % 5
        if ms == 1900 or (early_granule and ms == 200):
            pins.value += 60
        rig.run_round(ms * MS)
    fields = pins.sent[-1].split(b"*")[0].split(b",")
    return [
        int(fields[2]),
        int(fields[3]),
        int(fields[7]) // MS,
        int(fields[8]) // MS if fields[8] else -1,
        int(fields[9]),
    ]


class Wire:
    """A pin of a fake part: what is put on it goes to `heard`, what is read comes from `says`."""

    def __init__(self, heard=None, says=None):
        self._heard, self._says = heard, says

    def value(self, level=None):
        if level is None:
            return self._says()
        if self._heard:
            self._heard(level)
        return None


class FakeHx711:
    """Gives one conversion, most significant bit first: the next bit at each rise of the clock.
    Data stays low until it has been fetched."""

    def __init__(self):
        self.count, self.pulses, self.ready, self.level = 0, 0, False, 0

    def convert(self, count):
        self.count, self.pulses, self.ready = count & 0xFFFFFF, 0, True

    def clock(self, level):
        if level and not self.level:
            self.pulses += 1
            if self.pulses == 25:
                self.ready = False
        self.level = level

    def data(self):
        if not self.ready:
            return 1
        return 0 if self.pulses == 0 else (self.count >> (24 - min(self.pulses, 24))) & 1


def scale():
    """kg of a list of conversions, how many pulses each took; then a broken cell, silence, and
    back again."""
    part = FakeHx711()
    read = Hx711LoadCell(Wire(heard=part.clock), Wire(says=part.data), 0.001, 5.0)
    found = [read.kg]
    for count in (0, 100000, -5000, 0x7FFFFE, 0x7FFFFF, 20000):
        part.convert(count)
        read.poll_conversion()
        found.append([None if read.kg is None else round(read.kg, 3), part.pulses])
    for _ in range(900):
        read.poll_conversion()
    found.append(round(read.kg, 3))
    for _ in range(200):
        read.poll_conversion()
    found.append(read.kg)
    part.convert(1000)
    read.poll_conversion()
    found.append(round(read.kg, 3))
    return found


class FakeLis3dh:
    """Registers of the accelerometer; `gone`: nobody answers."""

    def __init__(self):
        self.g, self.gone, self.written, self.who = (0.0, 0.0, 1.0), False, [], 0x33

    def readfrom_mem(self, address, register, count):
        if self.gone or address != 0x18:
            raise OSError(5)
        if register == 0x0F:
            return bytes([self.who])
        raw = b""
        for axis in self.g:
            # twelve bits, left in the word, 1 mg each
            value = int(axis * 1000.0) * 16 & 0xFFFF
            raw += bytes([value & 0xFF, value >> 8])
        return raw

    def writeto_mem(self, address, register, data):
        self.written.append([register, data[0]])


def tilt():
    """Registers set; pitch and roll in degrees: flat, nose up, right side down, jolted; gone,
    back, another part."""
    part = FakeLis3dh()
    read = Lis3dhInclinometer(part)

    def settled(g):
        part.g = g
        for _ in range(100):
            read.poll_sample(0.05)
        return (
            None if read.pitch_deg is None else [round(read.pitch_deg, 1), round(read.roll_deg, 1)]
        )

    found = [settled((0.0, 0.0, 1.0)), part.written[:]]
    found += [settled((0.174, 0.0, 0.985)), settled((0.0, -0.174, 0.985)), settled((1.5, 1.0, 1.0))]
    part.g = (0.5, 0.0, 0.866)
    read.poll_sample(0.05)
    found.append(round(read.pitch_deg, 1))
    part.gone = True
    found.append(settled((0.0, 0.0, 1.0)))
    part.gone = False
    found.append(settled((0.0, 0.0, 1.0)))
    part.who = 0x11
    part.gone = True
    read.poll_sample(0.05)
    part.gone = False
    found.append(settled((0.0, 0.0, 1.0)))
    return found


SCENARIOS = {
    "safe_stop": safe_stop,
    "valves": valves,
    "valve_switches": valve_switches,
    "power_on": power_on,
    "stop_at_once": stop_at_once,
    "driver_fault": driver_fault,
    "bad_frames": bad_frames,
    "limits": limits,
    "orders_with_a_word": orders_with_a_word,
    "orders_without_a_word": orders_without_a_word,
    "orders_without_a_word_at_a_new_board": lambda: orders_without_a_word((5,)),
    "orders_without_a_word_refused": lambda: orders_without_a_word((5,), True),
    "shaft_step": shaft_step,
    "shaft_step_after_jam": lambda: shaft_step(0.0),
    "shaft_step_after_hand": lambda: shaft_step(50.0),
    "shaft_step_weak_supply": lambda: shaft_step(None, 100.0),
    "gate_moves": gate_moves,
    "gate_moves_homed": lambda: gate_moves(False),
    "gate_step": gate_step,
    "lost_steps": lost_steps,
    "doses": doses,
    "metering_stepper": metering_stepper,
    "stepper_falls_out_of_step": stepper_falls_out_of_step,
    "turned": turned,
    "own_settings": own_settings,
    "usb_line": usb_line,
    "lag_rig": lag_rig,
    "scale": scale,
    "tilt": tilt,
    "lag_rig_early_granule": lambda: lag_rig(True),
}


def main():
    import json

    for name in sorted(SCENARIOS):
        print(json.dumps([name, SCENARIOS[name]()]))
