"""Words the Job screen: checks before work, totals, refills. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from topdress.console.app import frame_words
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.pages.job.map_words import describe_map_check, is_doubtful
from topdress.console.app.pages.job.service import JobFacts
from topdress.console.app.panel_views import (
    MAX_FRESH_AGE_S,
    AgedText,
    ItemView,
    format_duration,
    format_local_time,
    list_point_items,
)
from topdress.console.app.remaining_work import estimate_remaining
from topdress.console.app.typed_number import format_with_unit
from topdress.console.app.units import Units
from topdress.console.frame import DeviceView, Frame
from topdress.console.locale import N_, _
from topdress.control.agronomy.reference_strips import (
    ENOUGH_N_SUFFICIENCY,
    ReferenceStrips,
    StripMean,
    calc_measured_index,
    find_index_doubt,
)
from topdress.control.field.job_totals import Totals
from topdress.control.orders import CANOPY_SOURCES, MAP_SOURCES
from topdress.drivers.devices.registry import list_devices

if TYPE_CHECKING:
    from topdress.control.machine.machine import Adopted

# Levels of a check: "look" permits work, "stop" means that the job cannot start properly.
OK, LOOK, STOP = "ok", "look", "stop"
LEVEL_WORDS = {OK: N_("ok"), LOOK: N_("look"), STOP: N_("STOP")}
# Masses are shown to 0.1 kg, and a normal stop itself drops some 0.1 kg.
MIN_SHOWN_STOPPED_KG = 0.05
# A device that is silent for longer than this, s, is reported.
MAX_DEVICE_SILENCE_S = 2.0
# Below this free space, bytes, a log of a day may not fit.
MIN_FREE_BYTES = 200_000_000
# Below this free space, bytes, the operator is warned: some days of logs are left.
LOW_FREE_BYTES = 2_000_000_000
# Scales of growth stages that a crop file may use.
GROWTH_SCALE_NAMES = {"feekes": N_("Feekes"), "bbch": N_("BBCH"), "days": N_("growing days")}
# Notices, notes and questions about a strip, by its kind.
STRIP_BEGINS = {
    "nrich": N_("N-rich strip begins here; B again at its end, after {least} or more"),
    "check": N_("farmer check begins here; B again at its end, after {least} or more"),
}
STRIP_RUNS = {
    "nrich": N_("N-rich strip: {way}  NDVI {ndvi}  CV {cv} %   B ends it"),
    "check": N_("farmer check: {way}  NDVI {ndvi}  CV {cv} %   B ends it"),
}
STRIP_TITLES = {
    "nrich": N_("NDVI {ndvi} as the N-rich strip of this job?"),
    "check": N_("NDVI {ndvi} as the farmer check of this job?"),
}
# Words for devices by their names in the frame.
DEVICE_NAMES = {one.section: one.title for one in list_devices()}


class JobCheck(NamedTuple):
    """Holds one check; `full` has everything where the list may lack the room."""

    label: str
    level: str
    text: str
    full: tuple[str, ...] = ()


def list_checks(
    frame: Frame | None,
    age_s: float,
    facts: JobFacts | None,
    trouble: str,
    free_bytes: int | None,
    units: Units,
    is_elsewhere: bool = False,
) -> tuple[JobCheck, ...]:
    """Return the checks before work.

    Parameters
    ----------
    frame
        Newest frame, or None.
    age_s
        Age of the frame, s.
    facts
        Contents of the job's files; None while they are being read.
    trouble
        Reason why the files cannot be read, in one line.
    free_bytes
        Free space at the log; None where unknown.
    units
        Units of the texts.
    is_elsewhere
        Whether this console, such as a tablet, cannot read the files of the machine's computer:
        what stands in them is not checked here.
    """
    found = [_check_devices(frame, age_s)]
    if facts is None and not is_elsewhere:
        found.append(JobCheck(_("job"), STOP if trouble else LOOK, trouble or _("being read")))
    elif facts is not None:
        found += [
            *_list_job_names(facts),
            _check_crop(facts),
            *_check_growth(facts),
            *_check_year_nitrogen(facts),
            _check_strip(facts, frame),
            *_check_response_index(facts, frame),
            *_check_product(facts),
            _check_limits(facts, units),
            _check_field(facts, units),
            *_check_map(facts, units),
            _check_machine(facts),
        ]
    found += [_check_hopper(frame, age_s, units), _check_log(frame, free_bytes, is_elsewhere)]
    return tuple(found)


def find_file_name(path: str) -> str:
    """Return the last part of a path, with separators of either kind of system."""
    # A log that was written on Windows may be read on Linux.
    return path.replace("\\", "/").rpartition("/")[2]


def find_worst_level(found: tuple[JobCheck, ...]) -> str:
    """Return the worst level of the checks."""
    levels = {check.level for check in found}
    return next((level for level in (STOP, LOOK) if level in levels), OK)


def _check_devices(frame: Frame | None, age_s: float) -> JobCheck:
    """Check whether all devices send values; a silent drive prevents work."""
    label = _("devices")
    # Without fresh values the list of devices may be outdated.
    if frame is None or age_s > MAX_FRESH_AGE_S:
        return JobCheck(label, STOP, _("no values from the machine"))
    if not frame.devices:
        return JobCheck(label, STOP, _("no device is configured"))
    silent = [
        one
        for one in frame.devices
        if not one.connected or one.age_s is None or one.age_s > MAX_DEVICE_SILENCE_S
    ]
    lines = tuple(f"{_name_device(one)}: {one.port}  {one.rate_hz:.0f} Hz" for one in frame.devices)
    simulated = f"  {_('SIMULATED')}" if frame.simulated else ""
    if silent:
        # A silent drive prevents work; a silent receiver or head only reduces its quality.
        drive = any(one.name in ("board", "rate_module") for one in silent)
        names = ", ".join(_name_device(one) for one in silent)
        return JobCheck(
            label,
            STOP if drive else LOOK,
            _("silent: {names}").format(names=names) + simulated,
            lines,
        )
    # Six heads in the list would hide the other devices, so they are counted.
    heads = [one for one in frame.devices if one.name.startswith("head_")]
    others = ", ".join(_name_device(one) for one in frame.devices if one not in heads)
    text = f"{others}, {_('{count} heads').format(count=len(heads))}" if heads else others
    return JobCheck(label, OK, text + simulated, lines)


def _name_device(one: DeviceView) -> str:
    """Return the word for a device."""
    # Heads are numbered: head_1 to head_6.
    name, _line, number = one.name.partition("_")
    if name == "head" and number:
        return _("head {number}").format(number=number)
    return _(DEVICE_NAMES.get(one.name, one.name))


def _list_job_names(facts: JobFacts) -> tuple[JobCheck, ...]:
    """Return client, farm, product and operator; nothing where no name is given."""
    names = facts.names
    said = [one for one in (names.client, names.farm, names.product, names.operator) if one]
    return (JobCheck(_("for"), OK, ", ".join(said)),) if said else ()


def translate_crop_note(note: str) -> str:
    """Translate a crop file's remark about itself. An author's own words are unchanged, and so are
    the names of keys after a colon."""
    # A remark may end with the names of keys of the crop file, which are no words to translate.
    head, colon, keys = note.partition(": ")
    known = _(note)
    return f"{_(head)}{colon}{keys}" if known == note else known


def _check_crop(facts: JobFacts) -> JobCheck:
    """Check the crop file's remarks about itself."""
    setup = facts.setup
    name, notes = (
        setup.crop.name,
        [translate_crop_note(note) for note in (*setup.job.warnings, *setup.crop.warnings)],
    )
    if notes:
        return JobCheck(
            _("crop"), LOOK, f"{name}: {notes[0]}", (f"{name} ({facts.crop_file})", *notes)
        )
    return JobCheck(_("crop"), OK, name, (facts.crop_file,))


def _check_year_nitrogen(facts: JobFacts) -> tuple[JobCheck, ...]:
    """Return the nitrogen that the field may still receive this year; nothing where the job has no
    ceiling."""
    year = facts.setup.n_year
    if year is None:
        return ()
    said = _("at most {ceiling} kg N/ha, {given} given: {left} left on any place")
    return (
        JobCheck(
            _("nitrogen of the year"),
            OK,
            said.format(
                ceiling=f"{year.ceiling_kg_ha:g}",
                given=f"{year.given_kg_ha + year.earlier_kg_ha:.0f}",
                left=f"{year.left_kg_ha:.0f}",
            ),
        ),
    )


def _check_growth(facts: JobFacts) -> tuple[JobCheck, ...]:
    """Check the growth stage, for a crop whose rule is valid for some stages."""
    growth = facts.setup.growth
    if growth is None:
        return ()
    label, scale = _("growth stage"), _(GROWTH_SCALE_NAMES[growth.scale])
    first, last = f"{growth.first:g}", f"{growth.last:g}"
    # The rule may still be right, so a missing stage is a warning only.
    if growth.stage is None:
        return (
            JobCheck(
                label,
                LOOK,
                _("not said; the rule holds from {scale} {first} to {last}").format(
                    scale=scale, first=first, last=last
                ),
            ),
        )
    if growth.is_outside:
        return (
            JobCheck(
                label,
                LOOK,
                _("{scale} {stage}: the rule holds from {first} to {last} only").format(
                    scale=scale, stage=f"{growth.stage:g}", first=first, last=last
                ),
            ),
        )
    return (JobCheck(label, OK, f"{scale} {growth.stage:g}  ({first}-{last})"),)


def find_strips_in_force(frame: Frame | None, facts: JobFacts | None) -> ReferenceStrips:
    """Return the strips in force: the worker's, which include strips measured since its start, else
    those of the files."""
    # The worker measures strips during the run and knows them before the files do.
    live = frame.strips if frame is not None else ReferenceStrips()
    if facts is None:
        return live
    rule = facts.setup.rule
    return ReferenceStrips(live.nrich or rule.ndvi_nrich, live.check or rule.ndvi_check)


def describe_index_doubt(strips: ReferenceStrips) -> str:
    """Return why the field's response index is doubtful; "" where it is plausible."""
    index, why = calc_measured_index(strips), find_index_doubt(strips)
    if index is None or not why:
        return ""
    said = (
        _(
            "RI {index}: the N-rich strip is no greener than the check. No response: "
            "nothing will be given."
        )
        if why == "below_1"
        else _(
            "RI {index}: above 3 is not to be believed. Were both strips of this crop, on this day?"
        )
    )
    return said.format(index=f"{index:.2f}")


def compare_strip_rates(
    facts: JobFacts | None,
    before: ReferenceStrips,
    after: ReferenceStrips,
    field_ndvi: float | None,
    units: Units,
) -> str:
    """Compare the canopy's target in this field without and with a strip, by the crop's rule; ""
    where unknown."""
    if facts is None or field_ndvi is None:
        return ""
    rates = []
    for strips in (before, after):
        # The rule of the job itself decides, so the comparison agrees with the worker.
        rule = replace(facts.setup.rule, ndvi_nrich=strips.nrich, ndvi_check=strips.check)
        decided = rule.decide_rate(field_ndvi)
        rates.append(
            units.rate.format_with_name(
                decided.rate_kg_ha if rule.is_ready else facts.setup.crop.fallback_rate_kg_ha
            )
        )
    return _(
        "Target from canopy in this field, NDVI {ndvi}: {before} now, {after} with it."
    ).format(ndvi=f"{field_ndvi:.3f}", before=rates[0], after=rates[1])


def describe_poor_strip(strip: StripMean | None, field_ndvi: float | None) -> str:
    """Return a warning if an N-rich strip is hardly greener than the field, else "". The strip is
    then no N-rich strip, or the field has enough nitrogen."""
    if (
        strip is None
        or strip.which != "nrich"
        or strip.ndvi is None
        or field_ndvi is None
        or field_ndvi < ENOUGH_N_SUFFICIENCY * strip.ndvi
    ):
        return ""
    return _(
        "! The strip is hardly richer than the field (NDVI {field}): little or nothing will "
        "be given. "
        "Was it driven in the N-rich strip?"
    ).format(field=f"{field_ndvi:.3f}")


def _check_response_index(facts: JobFacts, frame: Frame | None) -> tuple[JobCheck, ...]:
    """Check the response index, for a job whose rule uses it."""
    if (
        facts.setup.rule.response_rule != "field"
        or facts.setup.job.target.source not in CANOPY_SOURCES
    ):
        return ()
    label, strips = _("response index"), find_strips_in_force(frame, facts)
    # Both strips must be of this field and day, because the index compares them.
    index = calc_measured_index(strips)
    if index is None:
        missing = (
            _("farmer check missing: drive one with B")
            if strips.nrich is not None
            else (_("no strips yet: drive both with B"))
        )
        return (JobCheck(label, LOOK, missing),)
    said = describe_index_doubt(strips)
    if said:
        return (JobCheck(label, LOOK, said),)
    return (
        JobCheck(
            label,
            OK,
            _("RI {index}: N-rich {nrich} over check {check}").format(
                index=f"{index:.2f}", nrich=f"{strips.nrich:.3f}", check=f"{strips.check:.3f}"
            ),
        ),
    )


def _check_strip(facts: JobFacts, frame: Frame | None) -> JobCheck:
    """Check where the NDVI of the N-rich strip comes from."""
    label, job, crop = _("N-rich strip"), facts.setup.job, facts.setup.crop
    if job.target.source not in CANOPY_SOURCES:
        return JobCheck(
            label,
            OK,
            _("not needed: {source} in use").format(
                source=frame_words.name_source(job.target.source)
            ),
        )
    live = frame.strips.nrich if frame is not None else None
    # The strip that was measured today has priority over those of the files.
    if live is not None and live != facts.setup.rule.ndvi_nrich:
        return JobCheck(label, OK, f"NDVI {live:.3f}  {_('measured on the way')}")
    if job.ndvi_nrich is not None:
        return JobCheck(label, OK, f"NDVI {job.ndvi_nrich:.3f}  {_('of the job')}")
    if crop.ndvi_nrich is not None:
        return JobCheck(
            label, LOOK, f"NDVI {crop.ndvi_nrich:.3f}  {_('of the crop file, not of this field')}"
        )
    if crop.fixed_yield_t_ha is not None:
        return JobCheck(
            label,
            LOOK,
            _("none; a fixed yield of {yield_t_ha} t/ha is used").format(
                yield_t_ha=f"{crop.fixed_yield_t_ha:g}"
            ),
        )
    return JobCheck(label, LOOK, _("none: drive one with B"))


def _check_product(facts: JobFacts) -> tuple[JobCheck, ...]:
    """Check the product, for a job that names one of the library."""
    product, machine = facts.setup.product, facts.setup.machine
    if product is None:
        return ()
    label, name, percent = (
        _("product"),
        facts.names.product,
        f"{100.0 * facts.setup.crop.product_n_fraction:.0f}",
    )
    # The flow of a product depends on the machine, so only a catch test with this machine counts.
    test = product.find_newest_test(machine.id)
    if test is None:
        return (
            JobCheck(
                label,
                LOOK,
                _(
                    "{product}, {percent} % N: no catch test with this machine, whose own file "
                    "counts"
                ).format(product=name, percent=percent),
                (facts.product_file,),
            ),
        )
    return (
        JobCheck(
            label,
            OK,
            _("{product}, {percent} % N, {grams} g a turn and mm (catch test of {date})").format(
                product=name,
                percent=percent,
                grams=f"{machine.flow.grams_per_rev_mm:.2f}",
                date=test.date.isoformat(),
            ),
            (facts.product_file,),
        ),
    )


def _check_limits(facts: JobFacts, units: Units) -> JobCheck:
    """Return the rate limits of the crop."""
    return JobCheck(
        _("limits"),
        OK,
        _("at most {most}; without canopy {fallback}").format(
            most=units.rate.format_with_name(facts.setup.crop.max_rate_kg_ha),
            fallback=units.rate.format_with_name(facts.setup.crop.fallback_rate_kg_ha),
        ),
    )


def _check_field(facts: JobFacts, units: Units) -> JobCheck:
    """Check whether the field has a boundary."""
    if facts.field_ha is None:
        return JobCheck(
            _("field"), LOOK, _("no boundary: nothing stops the flow at the field's edge")
        )
    return JobCheck(
        _("field"), OK, f"{facts.field}  {units.area.format_with_name(facts.field_ha)}".strip()
    )


def _check_map(facts: JobFacts, units: Units) -> tuple[JobCheck, ...]:
    """Check the map, for a job that names one. Without a readable map, a map job cannot start."""
    label, name = _("map"), find_file_name(facts.map_file)
    if facts.map_trouble:
        return (
            JobCheck(
                label,
                STOP if facts.setup.job.target.source in MAP_SOURCES else LOOK,
                facts.map_trouble,
            ),
        )
    if facts.map_check is None:
        return ()
    # Remarks about a plausible map stay in the details.
    said = describe_map_check(facts.map_check, units)
    doubtful = is_doubtful(facts.map_check) and bool(said)
    if doubtful:
        return (JobCheck(label, LOOK, said[0], (facts.map_file, *said)),)
    return (JobCheck(label, OK, name, (facts.map_file, *said)),)


def _check_machine(facts: JobFacts) -> JobCheck:
    """Return the machine file's row: the corrections adopted from a diagnosis; a warning if the
    file is still as delivered."""
    label, machine = _("machine"), facts.setup.machine
    name = machine.title or machine.id
    if machine.adopted:
        text = _("{machine}: effects adopted from data: {count}").format(
            machine=name, count=len(machine.adopted)
        )
        return JobCheck(
            label, OK, text, (facts.machine_file, *map(_format_adopted, machine.adopted))
        )
    if facts.shipped_machine:
        return JobCheck(
            label,
            LOOK,
            _("{machine}: as delivered, not calibrated here").format(machine=name),
            (facts.machine_file,),
        )
    return JobCheck(label, OK, name, (facts.machine_file,))


def _format_adopted(one: Adopted) -> str:
    """Return an adopted effect with the data from which it was estimated."""
    return f"{one.id} {one.size:+g} {one.unit}".rstrip() + (
        f"  ({one.data}, {one.date})" if one.data else ""
    )


def _check_hopper(frame: Frame | None, age_s: float, units: Units) -> JobCheck:
    """Check the fill level of the hopper."""
    label = _("hopper")
    if frame is None or frame.row.hopper_kg is None:
        return JobCheck(label, LOOK, _("no scale: fill level not known"))
    if age_s > MAX_FRESH_AGE_S:
        return JobCheck(
            label,
            LOOK,
            _("was {state}").format(state=units.mass.format_with_name(frame.row.hopper_kg)),
        )
    # The alarm has hysteresis, so the list does not flicker with the scale's noise.
    low = any(alarm.id.startswith("hopper") for alarm in frame.alarms)
    return JobCheck(label, LOOK if low else OK, units.mass.format_with_name(frame.row.hopper_kg))


def _check_log(frame: Frame | None, free_bytes: int | None, is_elsewhere: bool) -> JobCheck:
    """Check whether a log is written and has free space."""
    label = _("log")
    if frame is None or not frame.log_path:
        return JobCheck(label, STOP, _("no log is written"))
    tally = frame.tally
    if tally is not None and tally.trouble:
        return JobCheck(
            label, LOOK, _("after a power cut the job could not go on"), (tally.trouble,)
        )
    if is_elsewhere:
        return JobCheck(label, OK, find_file_name(frame.log_path), (frame.log_path,))
    if free_bytes is None:
        return JobCheck(label, LOOK, _("free space not known"), (frame.log_path,))
    # Disks are sold and reported in decimal gigabytes.
    gigabytes = free_bytes / 1e9
    text = _("{free} GB free").format(free=f"{gigabytes:.1f}")
    level = STOP if free_bytes < MIN_FREE_BYTES else LOOK if free_bytes < LOW_FREE_BYTES else OK
    return JobCheck(label, level, f"{text}  {find_file_name(frame.log_path)}", (frame.log_path,))


def make_total_items(
    frame: Frame | None, age_s: float, units: Units, picture: FieldPicture | None = None
) -> tuple[ItemView, ...]:
    """Return the totals of the job, including its parts before a power cut, and the remaining
    work."""
    t = frame.totals if frame is not None else None
    tally = frame.tally if frame is not None else None
    old = age_s > MAX_FRESH_AGE_S
    if frame is None or t is None:
        return tuple(
            ItemView(label, AgedText("--", True))
            for label in (_("area"), _("applied"), _("mean rate"))
        )
    cv, cuc = (
        "--" if value is None else f"{value:.1f} %" for value in (t.cv_percent, t.cuc_percent)
    )
    error = "--" if t.error_percent is None else f"{t.error_percent:+.1f} %"
    # A worker without a snapshot sends no tally.
    held_s = 0.0 if tally is None else tally.held_s
    # A rate per hour from less than a minute of work would be meaningless.
    moves_h = None if tally is None or t.worked_s < 60.0 else tally.moves * 3600.0 / t.worked_s
    filled = None if tally is None else sum(kg for _utc, kg in tally.refills)
    items = [
        ItemView(
            # The remaining work comes first, because an operator plans refills and time by it.
            _("to finish"),
            AgedText(estimate_remaining(frame, picture).format_remaining(units), old),
        ),
        ItemView(_("area"), AgedText(units.area.format_with_name(t.area_ha), old)),
        ItemView(_("applied"), AgedText(units.mass.format_with_name(t.applied_kg), old)),
        *(
            ()
            # The row appears only when the mass is worth mentioning.
            if t.stopped_kg < MIN_SHOWN_STOPPED_KG
            else (
                ItemView(
                    _("while stopped"),
                    AgedText(units.mass._replace(decimals=1).format_with_name(t.stopped_kg), old),
                ),
            )
        ),
        ItemView(_("covered"), AgedText(_format_covered(t, units), old)),
        ItemView(_("mean rate"), AgedText(units.rate.format_with_name(t.mean_rate_kg_ha), old)),
        ItemView(
            _("N used"),
            AgedText(units.mass._replace(decimals=1).format_with_name(t.applied_n_kg), old),
        ),
        *(
            # In point mode single doses replace the figures of evenness.
            list_point_items(frame, old, units)
            or (
                ItemView(_("against target"), AgedText(error, old)),
                ItemView(_("evenness"), AgedText(f"CV {cv}  C_uc {cuc}", old)),
            )
        ),
        ItemView(_("working"), AgedText(format_duration(t.worked_s), old)),
        ItemView(_("held"), AgedText(format_duration(held_s), old)),
        ItemView(
            _("gate moves"),
            AgedText(
                "--" if moves_h is None else _("{count} an hour").format(count=f"{moves_h:.0f}"),
                old,
            ),
        ),
        ItemView(
            _("filled in"),
            AgedText("--" if filled is None else units.mass.format_with_name(filled), old),
        ),
    ]
    return tuple(items)


def _format_covered(t: Totals, units: Units) -> str:
    """Return the area that received material, each position once, and the area that was passed
    again."""
    if t.covered_ha is None or t.overlap_ha is None:
        return "--"
    return (
        f"{units.area.format_with_name(t.covered_ha)}  "
        f"{_('twice {area}').format(area=units.area.format_with_name(t.overlap_ha))}"
    )


def list_refills(frame: Frame | None, units: Units, utc_offset_s: float) -> tuple[str, ...]:
    """Return each refill with its time of day, newest first."""
    if frame is None or frame.tally is None:
        return ()
    return tuple(
        f"{format_local_time(utc, utc_offset_s)}  {format_with_unit(units.mass, round(kg, 1))}"
        # The newest refill is the one that an operator may want to undo.
        for utc, kg in reversed(frame.tally.refills)
    )
