"""The Job screen's words: the check list before work, the totals, what was filled in. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from topdress.console.app import words
from topdress.console.app.field_picture import FieldPicture
from topdress.console.app.pages.job.map_words import is_doubtful, map_words
from topdress.console.app.pages.job.service import Facts
from topdress.console.app.remaining_work import remaining_work
from topdress.console.app.typed_number import in_words
from topdress.console.app.units import Units
from topdress.console.app.view import (
    STALE_S,
    Item,
    Shown,
    duration,
    format_local_time,
    list_point_items,
)
from topdress.console.frame import DeviceView, Frame
from topdress.console.locale import N_, _
from topdress.control.agronomy.strips import (
    ENOUGH_N_SUFFICIENCY,
    Strips,
    StripValue,
    calc_measured_index,
    find_index_doubt,
)
from topdress.control.field.totals import Totals
from topdress.control.orders import CANOPY_SOURCES, MAP_SOURCES

if TYPE_CHECKING:
    from topdress.control.machine.machine import Adopted

OK, LOOK, STOP = "ok", "look", "stop"
LEVEL_WORDS = {OK: N_("ok"), LOOK: N_("look"), STOP: N_("STOP")}
# shown to 0.1 kg; a stop's own run-down is some 0.1 kg
LEAST_STOPPED_KG = 0.05
SILENT_S = 2.0  # a device that said nothing for this long
LEAST_FREE_BYTES = 200_000_000
LOW_FREE_BYTES = 2_000_000_000
SCALES = {"feekes": N_("Feekes"), "bbch": N_("BBCH"), "days": N_("growing days")}
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
DEVICE_WORDS = {
    "gnss": N_("GNSS"),
    "heads": N_("canopy heads"),
    "board": N_("drive board"),
    "rate_module": N_("rate module"),
    "lag_rig": N_("lag rig"),
    "tractor": N_("tractor"),
    "rate_line": N_("other display"),
}


class Check(NamedTuple):
    """One line of the list. full: everything, where the line may have no room for it."""

    label: str
    level: str
    text: str
    full: tuple[str, ...] = ()


def checks(
    frame: Frame | None,
    age_s: float,
    facts: Facts | None,
    trouble: str,
    free_bytes: int | None,
    units: Units,
) -> tuple[Check, ...]:
    """The list before work. facts: None while they are being read; trouble: why they cannot be,
    one line."""
    found = [_devices(frame, age_s)]
    if facts is None:
        found.append(Check(_("job"), STOP if trouble else LOOK, trouble or _("being read")))
    else:
        found += [
            *_who(facts),
            _crop(facts),
            *_growth(facts),
            *_year_n(facts),
            _strip(facts, frame),
            *_response(facts, frame),
            *_product(facts),
            _limits(facts, units),
            _field(facts, units),
            *_map(facts, units),
            _machine(facts),
        ]
    found += [_hopper(frame, age_s, units), _log(frame, free_bytes)]
    return tuple(found)


def file_name(path: str) -> str:
    """The last part of a path of either kind of system."""
    return path.replace("\\", "/").rpartition("/")[2]


def worst(found: tuple[Check, ...]) -> str:
    levels = {check.level for check in found}
    return next((level for level in (STOP, LOOK) if level in levels), OK)


def _devices(frame: Frame | None, age_s: float) -> Check:
    label = _("devices")
    if frame is None or age_s > STALE_S:
        return Check(label, STOP, _("no values from the machine"))
    if not frame.devices:
        return Check(label, STOP, _("no device is configured"))
    silent = [
        one
        for one in frame.devices
        if not one.connected or one.age_s is None or one.age_s > SILENT_S
    ]
    lines = tuple(f"{_device(one)}: {one.port}  {one.rate_hz:.0f} Hz" for one in frame.devices)
    simulated = f"  {_('SIMULATED')}" if frame.simulated else ""
    if silent:
        drive = any(one.name in ("board", "rate_module") for one in silent)
        names = ", ".join(_device(one) for one in silent)
        return Check(
            label,
            STOP if drive else LOOK,
            _("silent: {names}").format(names=names) + simulated,
            lines,
        )
    heads = [one for one in frame.devices if one.name.startswith("head_")]
    others = ", ".join(_device(one) for one in frame.devices if one not in heads)
    text = f"{others}, {_('{count} heads').format(count=len(heads))}" if heads else others
    return Check(label, OK, text + simulated, lines)


def _device(one: DeviceView) -> str:
    name, _line, number = one.name.partition("_")
    if name == "head" and number:
        return _("head {number}").format(number=number)
    return _(DEVICE_WORDS.get(one.name, one.name))


def _who(facts: Facts) -> tuple[Check, ...]:
    """Whose job it is; a line only where somebody said so."""
    names = facts.names
    said = [one for one in (names.client, names.farm, names.product, names.operator) if one]
    return (Check(_("for"), OK, ", ".join(said)),) if said else ()


def read_crop_note(note: str) -> str:
    """What a crop file notes about itself, in the language in use; what its author wrote stays
    as it is. The names of keys behind a colon are those of the file."""
    head, colon, keys = note.partition(": ")
    known = _(note)
    return f"{_(head)}{colon}{keys}" if known == note else known


def _crop(facts: Facts) -> Check:
    setup = facts.setup
    name, notes = (
        setup.crop.name,
        [read_crop_note(note) for note in (*setup.job.warnings, *setup.crop.warnings)],
    )
    if notes:
        return Check(
            _("crop"), LOOK, f"{name}: {notes[0]}", (f"{name} ({facts.crop_file})", *notes)
        )
    return Check(_("crop"), OK, name, (facts.crop_file,))


def _year_n(facts: Facts) -> tuple[Check, ...]:
    """What the field may still get this year; none where the job has no ceiling."""
    year = facts.setup.n_year
    if year is None:
        return ()
    said = _("at most {ceiling} kg N/ha, {given} given: {left} left on any place")
    return (
        Check(
            _("nitrogen of the year"),
            OK,
            said.format(
                ceiling=f"{year.ceiling_kg_ha:g}",
                given=f"{year.given_kg_ha + year.earlier_kg_ha:.0f}",
                left=f"{year.left_kg_ha:.0f}",
            ),
        ),
    )


def _growth(facts: Facts) -> tuple[Check, ...]:
    """Of a crop whose rule was made for some stages."""
    growth = facts.setup.growth
    if growth is None:
        return ()
    label, scale = _("growth stage"), _(SCALES[growth.scale])
    first, last = f"{growth.first:g}", f"{growth.last:g}"
    if growth.stage is None:
        return (
            Check(
                label,
                LOOK,
                _("not said; the rule holds from {scale} {first} to {last}").format(
                    scale=scale, first=first, last=last
                ),
            ),
        )
    if growth.is_outside:
        return (
            Check(
                label,
                LOOK,
                _("{scale} {stage}: the rule holds from {first} to {last} only").format(
                    scale=scale, stage=f"{growth.stage:g}", first=first, last=last
                ),
            ),
        )
    return (Check(label, OK, f"{scale} {growth.stage:g}  ({first}-{last})"),)


def find_present_strips(frame: Frame | None, facts: Facts | None) -> Strips:
    """As they count now: those of the worker, which knows what was measured since it began;
    else of the files."""
    live = frame.strips if frame is not None else Strips()
    if facts is None:
        return live
    rule = facts.setup.rule
    return Strips(live.nrich or rule.ndvi_nrich, live.check or rule.ndvi_check)


def describe_doubt(strips: Strips) -> str:
    """Why the response index of the field is not to be believed as it stands; empty where
    nothing speaks against it."""
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
    facts: Facts | None, before: Strips, after: Strips, field_ndvi: float | None, units: Units
) -> str:
    """The canopy's target on the field's ground without and with a strip, by the crop's rule;
    empty where it is not known."""
    if facts is None or field_ndvi is None:
        return ""
    rates = []
    for strips in (before, after):
        rule = replace(facts.setup.rule, ndvi_nrich=strips.nrich, ndvi_check=strips.check)
        decided = rule.decide_rate(field_ndvi)
        rates.append(
            units.rate.full(
                decided.rate_kg_ha if rule.is_ready else facts.setup.crop.fallback_rate_kg_ha
            )
        )
    return _(
        "Target from canopy in this field, NDVI {ndvi}: {before} now, {after} with it."
    ).format(ndvi=f"{field_ndvi:.3f}", before=rates[0], after=rates[1])


def hardly_richer_words(strip: StripValue | None, field_ndvi: float | None) -> str:
    """A strip that reads as the field does is no N-rich strip, or the field has enough; empty
    where it is richer."""
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


def _response(facts: Facts, frame: Frame | None) -> tuple[Check, ...]:
    """Of a job that goes by the response index of the field."""
    if (
        facts.setup.rule.response_rule != "field"
        or facts.setup.job.target.source not in CANOPY_SOURCES
    ):
        return ()
    label, strips = _("response index"), find_present_strips(frame, facts)
    index = calc_measured_index(strips)
    if index is None:
        missing = (
            _("farmer check missing: drive one with B")
            if strips.nrich is not None
            else (_("no strips yet: drive both with B"))
        )
        return (Check(label, LOOK, missing),)
    said = describe_doubt(strips)
    if said:
        return (Check(label, LOOK, said),)
    return (
        Check(
            label,
            OK,
            _("RI {index}: N-rich {nrich} over check {check}").format(
                index=f"{index:.2f}", nrich=f"{strips.nrich:.3f}", check=f"{strips.check:.3f}"
            ),
        ),
    )


def _strip(facts: Facts, frame: Frame | None) -> Check:
    label, job, crop = _("N-rich strip"), facts.setup.job, facts.setup.crop
    if job.target.source not in CANOPY_SOURCES:
        return Check(
            label,
            OK,
            _("not needed: {source} in use").format(source=words.name_source(job.target.source)),
        )
    live = frame.strips.nrich if frame is not None else None
    if live is not None and live != facts.setup.rule.ndvi_nrich:
        return Check(label, OK, f"NDVI {live:.3f}  {_('measured on the way')}")
    if job.ndvi_nrich is not None:
        return Check(label, OK, f"NDVI {job.ndvi_nrich:.3f}  {_('of the job')}")
    if crop.ndvi_nrich is not None:
        return Check(
            label, LOOK, f"NDVI {crop.ndvi_nrich:.3f}  {_('of the crop file, not of this field')}"
        )
    if crop.fixed_yield_t_ha is not None:
        return Check(
            label,
            LOOK,
            _("none; a fixed yield of {yield_t_ha} t/ha is used").format(
                yield_t_ha=f"{crop.fixed_yield_t_ha:g}"
            ),
        )
    return Check(label, LOOK, _("none: drive one with B"))


def _product(facts: Facts) -> tuple[Check, ...]:
    """Of a job that takes a product of the library."""
    product, machine = facts.setup.product, facts.setup.machine
    if product is None:
        return ()
    label, name, percent = (
        _("product"),
        facts.names.product,
        f"{100.0 * facts.setup.crop.product_n_fraction:.0f}",
    )
    test = product.find_newest_test(machine.id)
    if test is None:
        return (
            Check(
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
        Check(
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


def _limits(facts: Facts, units: Units) -> Check:
    return Check(
        _("limits"),
        OK,
        _("at most {most}; without canopy {fallback}").format(
            most=units.rate.full(facts.setup.crop.max_rate_kg_ha),
            fallback=units.rate.full(facts.setup.crop.fallback_rate_kg_ha),
        ),
    )


def _field(facts: Facts, units: Units) -> Check:
    if facts.field_ha is None:
        return Check(_("field"), LOOK, _("no boundary: nothing stops the flow at the field's edge"))
    return Check(_("field"), OK, f"{facts.field}  {units.area.full(facts.field_ha)}".strip())


def _map(facts: Facts, units: Units) -> tuple[Check, ...]:
    """Of a job that names one."""
    label, name = _("map"), file_name(facts.map_file)
    if facts.map_trouble:
        return (
            Check(
                label,
                STOP if facts.setup.job.target.source in MAP_SOURCES else LOOK,
                facts.map_trouble,
            ),
        )
    if facts.map_check is None:
        return ()
    said = map_words(facts.map_check, units)
    doubtful = is_doubtful(facts.map_check) and bool(said)
    if doubtful:
        return (Check(label, LOOK, said[0], (facts.map_file, *said)),)
    return (Check(label, OK, name, (facts.map_file, *said)),)


def _machine(facts: Facts) -> Check:
    label, machine = _("machine"), facts.setup.machine
    name = machine.title or machine.id
    if machine.adopted:
        text = _("{machine}: effects adopted from data: {count}").format(
            machine=name, count=len(machine.adopted)
        )
        return Check(label, OK, text, (facts.machine_file, *map(_adopted, machine.adopted)))
    if facts.shipped_machine:
        return Check(
            label,
            LOOK,
            _("{machine}: as delivered, not calibrated here").format(machine=name),
            (facts.machine_file,),
        )
    return Check(label, OK, name, (facts.machine_file,))


def _adopted(one: Adopted) -> str:
    """An adopted effect with the data that it comes from."""
    return f"{one.id} {one.size:+g} {one.unit}".rstrip() + (
        f"  ({one.data}, {one.date})" if one.data else ""
    )


def _hopper(frame: Frame | None, age_s: float, units: Units) -> Check:
    label = _("hopper")
    if frame is None or frame.row.hopper_kg is None:
        return Check(label, LOOK, _("no scale: fill level not known"))
    if age_s > STALE_S:
        return Check(
            label, LOOK, _("was {state}").format(state=units.mass.full(frame.row.hopper_kg))
        )
    low = any(alarm.id.startswith("hopper") for alarm in frame.alarms)
    return Check(label, LOOK if low else OK, units.mass.full(frame.row.hopper_kg))


def _log(frame: Frame | None, free_bytes: int | None) -> Check:
    label = _("log")
    if frame is None or not frame.log_path:
        return Check(label, STOP, _("no log is written"))
    tally = frame.tally
    if tally is not None and tally.trouble:
        return Check(label, LOOK, _("after a power cut the job could not go on"), (tally.trouble,))
    if free_bytes is None:
        return Check(label, LOOK, _("free space not known"), (frame.log_path,))
    gigabytes = free_bytes / 1e9
    text = _("{free} GB free").format(free=f"{gigabytes:.1f}")
    level = STOP if free_bytes < LEAST_FREE_BYTES else LOOK if free_bytes < LOW_FREE_BYTES else OK
    return Check(label, level, f"{text}  {file_name(frame.log_path)}", (frame.log_path,))


def totals(
    frame: Frame | None, age_s: float, units: Units, picture: FieldPicture | None = None
) -> tuple[Item, ...]:
    """What the job amounts to so far, its parts before a power cut included, and what it still
    takes."""
    t = frame.totals if frame is not None else None
    tally = frame.tally if frame is not None else None
    old = age_s > STALE_S
    if frame is None or t is None:
        return tuple(
            Item(label, Shown("--", True)) for label in (_("area"), _("applied"), _("mean rate"))
        )
    cv, cuc = (
        "--" if value is None else f"{value:.1f} %" for value in (t.cv_percent, t.cuc_percent)
    )
    error = "--" if t.error_percent is None else f"{t.error_percent:+.1f} %"
    held_s = 0.0 if tally is None else tally.held_s
    moves_h = None if tally is None or t.worked_s < 60.0 else tally.moves * 3600.0 / t.worked_s
    filled = None if tally is None else sum(kg for _utc, kg in tally.refills)
    items = [
        Item(_("to finish"), Shown(remaining_work(frame, picture).text(units), old)),
        Item(_("area"), Shown(units.area.full(t.area_ha), old)),
        Item(_("applied"), Shown(units.mass.full(t.applied_kg), old)),
        *(
            ()
            if t.stopped_kg < LEAST_STOPPED_KG
            else (
                Item(
                    _("while stopped"),
                    Shown(units.mass._replace(decimals=1).full(t.stopped_kg), old),
                ),
            )
        ),
        Item(_("covered"), Shown(_covered(t, units), old)),
        Item(_("mean rate"), Shown(units.rate.full(t.mean_rate_kg_ha), old)),
        Item(_("N used"), Shown(units.mass._replace(decimals=1).full(t.applied_n_kg), old)),
        *(
            list_point_items(frame, old, units)
            or (
                Item(_("against target"), Shown(error, old)),
                Item(_("evenness"), Shown(f"CV {cv}  C_uc {cuc}", old)),
            )
        ),
        Item(_("working"), Shown(duration(t.worked_s), old)),
        Item(_("held"), Shown(duration(held_s), old)),
        Item(
            _("gate moves"),
            Shown(
                "--" if moves_h is None else _("{count} an hour").format(count=f"{moves_h:.0f}"),
                old,
            ),
        ),
        Item(_("filled in"), Shown("--" if filled is None else units.mass.full(filled), old)),
    ]
    return tuple(items)


def _covered(t: Totals, units: Units) -> str:
    """Ground that got something, each place once, and what was passed over again."""
    if t.covered_ha is None or t.overlap_ha is None:
        return "--"
    return (
        f"{units.area.full(t.covered_ha)}  "
        f"{_('twice {area}').format(area=units.area.full(t.overlap_ha))}"
    )


def refills(frame: Frame | None, units: Units, utc_offset_s: float) -> tuple[str, ...]:
    """Each refill with its time of day, the newest first."""
    if frame is None or frame.tally is None:
        return ()
    return tuple(
        f"{format_local_time(utc, utc_offset_s)}  {in_words(units.mass, round(kg, 1))}"
        for utc, kg in reversed(frame.tally.refills)
    )
