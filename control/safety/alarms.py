"""Which alarms exist, and what is their life cycle? Raised, latched, acknowledged, ended."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from topdress.control.orders import Alarm, Severity, State
from topdress.control.safety.safety_interface import Details
from topdress.control.signals import N_


class AlarmKind(NamedTuple):
    """Describes one alarm of the published list. `str.format` fills `text` and `todo` with the
    alarm's details."""

    id: str
    severity: Severity
    text: str
    todo: str
    # Place where the operator finds the cause.
    place: str
    # State that the alarm causes; None for no change of state.
    leads_to: State | None = None


_AMBER, _RED = Severity.AMBER, Severity.RED

_ALARM_KINDS = (
    AlarmKind(
        "shaft_turns",
        _RED,
        N_(
            "Shaft turns though commanded to stop: use the hard-wired stop. "
            "{shaft_rpm} r/min, {released_kg} kg since that command."
        ),
        N_("Keep away from the machine. Use the hard-wired stop, then look at the drive board."),
        N_("drive board"),
        State.FAULT,
    ),
    AlarmKind(
        "gate_opens",
        _RED,
        N_(
            "Gate opens though commanded to stop: use the hard-wired stop. "
            "It is at {opening_mm} mm, commanded {told_mm} mm."
        ),
        N_("Keep away from the machine. Use the hard-wired stop, then look at the drive board."),
        N_("drive board"),
        State.FAULT,
    ),
    AlarmKind(
        "valve_open",
        _RED,
        N_(
            "Valve of section {sections} stays open though commanded to close: "
            "use the hard-wired stop."
        ),
        N_("Use the hard-wired stop, then look at the valve, its air and its cable."),
        N_("section valves"),
        State.HELD,
    ),
    AlarmKind(
        "flow_unordered",
        _RED,
        N_("The hopper loses {kg} kg while nothing turns: use the hard-wired stop."),
        N_(
            "Keep away from the machine. Use the hard-wired stop, then look at the shaft, "
            "its sensor and the "
            "hopper's outlet."
        ),
        N_("hopper"),
        State.FAULT,
    ),
    AlarmKind(
        "shaft_silent",
        _RED,
        N_("The metering shaft does not answer."),
        N_("Stop. Check power and cable of the drive board."),
        N_("drive board"),
        State.FAULT,
    ),
    AlarmKind(
        "gate_silent",
        _RED,
        N_("The opening does not answer."),
        N_("Stop. Check power and cable of the drive board."),
        N_("drive board"),
        State.FAULT,
    ),
    AlarmKind(
        "drive_fault",
        _RED,
        N_("A motor driver reports a fault."),
        N_("Stop. Look for what blocks the shaft or the gate, then at the driver's supply."),
        N_("drive board"),
        State.FAULT,
    ),
    AlarmKind(
        "drive_stopped",
        _RED,
        N_("The drive board stopped by itself: it missed the console, or its power."),
        N_(
            "Look at the machine, then make it ready again. If it comes back, check cable "
            "and supply."
        ),
        N_("drive board"),
        State.FAULT,
    ),
    AlarmKind(
        "shaft_far_off",
        _RED,
        N_("The shaft does not follow: it turns at {shaft_rpm} r/min, commanded {told_rpm} r/min."),
        N_(
            "Look for what jams or drags the shaft, at its gear and encoder, at battery and "
            "motor driver. If it "
            "turns on, use the hard-wired stop."
        ),
        N_("metering shaft"),
        State.FAULT,
    ),
    AlarmKind(
        "gate_far_off",
        _RED,
        N_("The gate does not follow: it stands at {opening_mm} mm and should be at {told_mm} mm."),
        N_("Look for what jams the gate, at its sensor, its motor and its driver; home it anew."),
        N_("gate"),
        State.FAULT,
    ),
    AlarmKind(
        "calibration_moved",
        _RED,
        N_("The machine moved while calibrating ({speed_mps} m/s)."),
        N_("Secure the machine against rolling, then begin again."),
        N_("machine"),
        State.FAULT,
    ),
    AlarmKind(
        "flow_missing",
        _RED,
        N_("The hopper loses {percent} % of what it should."),
        N_("Look for a bridge in the hopper and blocked outlets."),
        N_("hopper"),
        State.HELD,
    ),
    AlarmKind(
        "flow_above",
        _RED,
        N_("The hopper loses {percent} % of what shaft and opening say."),
        N_(
            "Look whether the shaft turns as it reads and the gate stands as it reads; "
            "check the scale."
        ),
        N_("metering"),
        State.HELD,
    ),
    AlarmKind(
        "hopper_empty",
        _RED,
        N_("The hopper is empty ({hopper_kg} kg)."),
        N_("Refill."),
        N_("hopper"),
        State.HELD,
    ),
    AlarmKind(
        "rate_above_limit",
        _RED,
        N_("{applied_kg_ha} kg/ha applied; the limit is {limit_kg_ha} kg/ha."),
        N_("Check the opening and the travel speed before going on."),
        N_("metering"),
        State.HELD,
    ),
    AlarmKind(
        "speed_silent",
        _RED,
        N_("No travel speed: GNSS and wheel are both silent."),
        N_("Check the wheel sensor and the GNSS receiver."),
        N_("speed"),
        State.HELD,
    ),
    AlarmKind(
        "speeds_differ",
        _RED,
        N_(
            "Wheel ({wheel_mps} m/s) and GNSS ({gnss_mps} m/s) disagree, and nothing says "
            "which one is wrong."
        ),
        N_(
            "Look at both. Drive on without flow: once they have agreed for 2 s, or the way "
            "between GNSS's places "
            "says which is wrong, start again."
        ),
        N_("speed"),
        State.HELD,
    ),
    AlarmKind(
        "console_silent",
        _RED,
        N_("The console was not heard for {limit_s} s."),
        N_("Look at the machine, then start again."),
        N_("console"),
        State.HELD,
    ),
    AlarmKind(
        "control_failed",
        _RED,
        N_("The console's program failed; the drives were stopped."),
        N_("Look at the machine, then make it ready again. Keep the log and report it."),
        N_("program"),
    ),
    AlarmKind(
        "log_failed",
        _RED,
        N_("The log cannot be written."),
        N_("Free disk space, or order to go on without a log."),
        N_("log"),
    ),
    AlarmKind(
        "position_lost",
        _RED,
        N_("No usable position; flow is stopped."),
        N_("Wait for GNSS, or change to canopy or manual."),
        N_("GNSS"),
    ),
    AlarmKind(
        "wheel_fault",
        _RED,
        N_("The wheel sensor gives no pulses at {speed_mps} m/s."),
        N_(
            "Check the wheel sensor, its gap and its cable. With GNSS ten times a second "
            "work may go on without "
            "it: H."
        ),
        N_("wheel sensor"),
    ),
    AlarmKind(
        "target_refused",
        _RED,
        N_("A target above {limit_kg_ha} kg/ha, or none that is a number, was refused."),
        N_("Check crop, prescription and manual rate."),
        N_("target"),
    ),
    AlarmKind(
        "rate_far_off",
        _RED,
        N_("The rate is off by {error_percent} %."),
        N_("Hold and check opening, shaft and hopper."),
        N_("metering"),
    ),
    AlarmKind(
        "outlet_blocked",
        _RED,
        N_(
            "Flow fell, and the drive works harder since: about {outlets} of {of} outlets "
            "give nothing, or the product is wet."
        ),
        N_(
            "Hold and look at the outlets. The others keep their rate: the scale does not raise it."
        ),
        N_("outlets"),
    ),
    AlarmKind(
        "flow_disagrees",
        _RED,
        N_(
            "By the scale the flow is off by {percent} %, more than is trimmed; the "
            "machine file's is used."
        ),
        N_("Do a catch test, or weigh a known load: which is right, machine file or scale?"),
        N_("hopper scale"),
    ),
    AlarmKind(
        "target_cut",
        _AMBER,
        N_(
            "{planned_kg_ha} kg/ha are wanted here; the crop's limit of {limit_kg_ha} kg/ha "
            "is applied."
        ),
        N_("Check the map's rates and their unit, the nudge, and the crop's limit."),
        N_("target"),
    ),
    AlarmKind(
        "target_silent",
        _AMBER,
        N_("The other display tells no target; until it does {silent_kg_ha} kg/ha are spread."),
        N_("Check the display and its cable, or take another source of the target."),
        N_("other display"),
    ),
    AlarmKind(
        "rate_off",
        _AMBER,
        N_("The rate is off by {error_percent} %."),
        N_("Watch it; slow down if the machine is at its limit."),
        N_("metering"),
    ),
    AlarmKind(
        "rate_above_range",
        _AMBER,
        N_(
            "{wanted_kg_ha} kg/ha are wanted; at this speed the machine gives at most "
            "{given_kg_ha} kg/ha, and spreads that."
        ),
        N_("Drive at {usable_kmh} km/h or slower, or set a lower rate."),
        N_("metering"),
    ),
    AlarmKind(
        "rate_below_range",
        _AMBER,
        N_(
            "{wanted_kg_ha} kg/ha are wanted, less than the machine can give at this speed: "
            "it spreads {given_kg_ha} kg/ha."
        ),
        N_("Drive at {usable_kmh} km/h or faster, or set a higher rate."),
        N_("metering"),
    ),
    AlarmKind(
        "wheel_too_much",
        _AMBER,
        N_(
            "The wheel sensor counts too much, or is stuck: {wheel_mps} m/s; GNSS's "
            "speed and places say {gnss_mps} m/s. GNSS gives the speed."
        ),
        N_(
            "Check slip, the wheel sensor and its cable. It counts again after 8 s that "
            "agree; before that flow "
            "does not begin from standstill."
        ),
        N_("wheel sensor"),
    ),
    AlarmKind(
        "wheel_too_little",
        _AMBER,
        N_(
            "The wheel sensor counts too little: {wheel_mps} m/s; GNSS's speed and "
            "places say {gnss_mps} m/s. GNSS gives the speed."
        ),
        N_(
            "Check the wheel sensor, its gap and its magnets. It counts again after 8 s "
            "that agree; before that "
            "flow does not begin from standstill."
        ),
        N_("wheel sensor"),
    ),
    AlarmKind(
        "gnss_speed_wrong",
        _AMBER,
        N_(
            "GNSS tells a wrong speed: {gnss_mps} m/s; the wheel says {wheel_mps} "
            "m/s, and so does the way between GNSS's places. The wheel gives the "
            "speed."
        ),
        N_(
            "Check the receiver's settings: unit and smoothing of its speed. It counts "
            "again after a minute that "
            "agrees; before that flow does not begin from standstill."
        ),
        N_("GNSS"),
    ),
    AlarmKind(
        "shaft_off",
        _AMBER,
        N_(
            "The shaft turns at {shaft_rpm} r/min and should turn at {told_rpm} r/min; where "
            "it rests the gate makes up for it."
        ),
        N_("Look at battery, motor, gear and encoder."),
        N_("metering shaft"),
    ),
    AlarmKind(
        "gate_off",
        _AMBER,
        N_(
            "The gate stands at {opening_mm} mm and should be at {told_mm} mm; where it rests "
            "the shaft makes up for it, else the rate is off by as much."
        ),
        N_("Look for what holds the gate; home it anew."),
        N_("gate"),
    ),
    AlarmKind(
        "effort_high",
        _AMBER,
        N_("The metering drive works {percent} % harder than it should: blocked, or wet product?"),
        N_(
            "Look at the outlets, for clods and stones. It goes when the grease is warm: "
            "run it warm. It stays: "
            "grease the shaft."
        ),
        N_("metering shaft"),
    ),
    AlarmKind(
        "effort_low",
        _AMBER,
        N_(
            "The metering drive turns with hardly any load: bridged, empty, or slower than "
            "it reads?"
        ),
        N_(
            "Look into the hopper; break the bridge. It is full: check the readings of shaft "
            "and gate."
        ),
        N_("hopper"),
    ),
    AlarmKind(
        "flow_below",
        _AMBER,
        N_(
            "{percent} % less flows than shaft and gate say: a blocked outlet, another lot, "
            "or a wrong reading of gate or shaft."
        ),
        N_(
            "Catch at each outlet: one gives less: clear it. All alike: measure gate and shaft; "
            "both right: catch test for the lot."
        ),
        N_("metering"),
    ),
    AlarmKind(
        "flow_trimmed",
        _AMBER,
        N_("The scale moves the flow by {percent} %."),
        N_("Do a catch test with this product; W switches the scale's trim off."),
        N_("hopper scale"),
    ),
    AlarmKind(
        "scale_unexplained",
        _AMBER,
        N_("The scale shows {kg} kg more or less than the flow explains."),
        N_("Look at the outlets, the shaft and the hopper. It is judged after 24 s of flow."),
        N_("hopper scale"),
    ),
    AlarmKind(
        "refill_disagrees",
        _AMBER,
        N_(
            "The scale's rise at the refill is off by {percent} %: the scale's gain, "
            "or the kg that were entered. It trims nothing."
        ),
        N_("Check what was filled in, then weigh a known load."),
        N_("hopper scale"),
    ),
    AlarmKind(
        "gnss_silent",
        _AMBER,
        N_("GNSS is silent or has no fix."),
        N_("Check the antenna and the receiver. The wheel gives the speed."),
        N_("GNSS"),
    ),
    AlarmKind(
        "position_jumped",
        _AMBER,
        N_("GNSS tells a place {off_m} m from where the machine can be; it is not used."),
        N_("Look at the map. A place that GNSS goes on telling is taken after a second."),
        N_("GNSS"),
    ),
    AlarmKind(
        "position_walks",
        _AMBER,
        N_(
            "GNSS walks off: its place lies {off_m} m from where its own speed and "
            "course lead; it is not used."
        ),
        N_(
            "Look at the map. A place that agrees with speed and course for a minute is "
            "taken again; if it comes "
            "back, change the receiver."
        ),
        N_("GNSS"),
    ),
    AlarmKind(
        "old_orders",
        _AMBER,
        N_("Somebody on the drive board's line plays in old orders; the board does not take them."),
        N_(
            "Look what else is on the board's line or network. Put the board on a cable of its own."
        ),
        N_("drive board"),
    ),
    AlarmKind(
        "log_cut",
        _AMBER,
        N_("Another program cut the log short; it goes on in a new one, {log}."),
        N_("Keep both. Look for what writes into the folder of the logs."),
        N_("log"),
    ),
    AlarmKind(
        "device_aside",
        _AMBER,
        N_("What {devices} said cannot be digested; it is not listened to any more."),
        N_("Connect it again on the Devices page. If it comes back, keep a capture and report it."),
        N_("devices"),
    ),
    AlarmKind(
        "ndvi_silent",
        _AMBER,
        N_("The canopy heads are silent; the fallback rate is used."),
        N_("Check the heads and their cable."),
        N_("canopy heads"),
    ),
    AlarmKind(
        "heads_by_map",
        _AMBER,
        N_("The canopy heads are silent; the index map stands in for them."),
        N_("Check the heads and their cable."),
        N_("canopy heads"),
    ),
    AlarmKind(
        "heads_few",
        _AMBER,
        N_("Only {valid_heads} canopy heads agree; at least {limit} are wanted."),
        N_("Clean and check the heads that are marked."),
        N_("canopy heads"),
    ),
    AlarmKind(
        "heads_full",
        _AMBER,
        N_(
            "All canopy heads read {limit} or more: no canopy does. The rate by it is "
            "not to be believed."
        ),
        N_("Look for what covers the heads; check their calibration, or change to a manual rate."),
        N_("canopy heads"),
    ),
    AlarmKind(
        "supply_low",
        _AMBER,
        N_("The supply is at {supply_v} V, below {limit} V: drives turn slower."),
        N_("Raise the engine speed; look at battery, alternator and cable."),
        N_("supply"),
    ),
    AlarmKind(
        "hopper_low",
        _AMBER,
        N_("{hopper_kg} kg left in the hopper, enough for {metres_left} m."),
        N_("Plan the refill."),
        N_("hopper"),
    ),
    AlarmKind(
        "lead_short",
        _AMBER,
        N_("Too fast for the heads' lead; at most {usable_speed_mps} m/s."),
        N_("Slow down."),
        N_("travel speed"),
    ),
    AlarmKind(
        "scale_silent",
        _AMBER,
        N_("The hopper scale is silent; bridging would not be noticed."),
        N_("Check the scale; look at the flow yourself."),
        N_("hopper scale"),
    ),
)

ALARMS: Mapping[str, AlarmKind] = MappingProxyType({kind.id: kind for kind in _ALARM_KINDS})
_ALARM_RANK = {kind.id: rank for rank, kind in enumerate(_ALARM_KINDS)}


class LiveAlarm(NamedTuple):
    """Holds a live alarm and the time when its cause was last present, s."""

    alarm: Alarm
    seen_s: float


def update_alarms(
    live: tuple[LiveAlarm, ...], now_s: float, troubles: Mapping[str, Details], clear_s: float
) -> tuple[LiveAlarm, ...]:
    """Returns the live alarms after this tick, worst first.

    An alarm ends when its cause has been absent for `clear_s`; a red alarm also needs an
    acknowledgement.
    """
    if not live and not troubles:
        return live
    kept = []
    for entry in live:
        alarm = entry.alarm
        details = troubles.get(alarm.id)
        if details is not None:
            same = details == alarm.details and alarm.gone_s is None
            kept.append(
                LiveAlarm(alarm if same else alarm._replace(details=details, gone_s=None), now_s)
            )
        elif now_s - entry.seen_s < clear_s or (
            alarm.severity is Severity.RED and not alarm.acknowledged
        ):
            known = alarm.gone_s is not None
            kept.append(
                entry if known else entry._replace(alarm=alarm._replace(gone_s=entry.seen_s))
            )
    booked_ids = {entry.alarm.id for entry in kept}
    new = [
        LiveAlarm(Alarm(i, ALARMS[i].severity, now_s, False, details), now_s)
        for i, details in troubles.items()
        if i not in booked_ids
    ]
    return tuple(sorted(kept + new, key=_sort_key)) if new else tuple(kept)


def acknowledge_alarms(live: tuple[LiveAlarm, ...], alarm_id: str) -> tuple[LiveAlarm, ...]:
    """Returns the alarms with one acknowledged, or all for an empty id."""
    return tuple(
        e._replace(alarm=e.alarm._replace(acknowledged=True)) if alarm_id in ("", e.alarm.id) else e
        for e in live
    )


def find_unacknowledged_red(live: tuple[LiveAlarm, ...]) -> str | None:
    """Returns the id of the worst red alarm without acknowledgement, or None."""
    return next(
        (e.alarm.id for e in live if e.alarm.severity is Severity.RED and not e.alarm.acknowledged),
        None,
    )


def _sort_key(entry: LiveAlarm) -> tuple[int, float]:
    return _ALARM_RANK[entry.alarm.id], entry.alarm.since_s
