"""How does `topdress map` read, summarise and convert prescriptions, and export run logs as
applied?
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from topdress.console.cli.inputs import MAP_FILE_KINDS, load_machine, refuse_other_kinds
from topdress.console.cli.outputs import (
    ForceOption,
    Output,
    find_machine_file,
    list_log_files,
    make_marked_output,
    refuse_collisions,
)
from topdress.console.cli.plain_errors import CommandError
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.drivers import day_clock
from topdress.drivers.files.formats.registry import describe_able, describe_endings, find_writer

# Type checking only: readers of maps load their libraries when a map is read.
if TYPE_CHECKING:
    from topdress.drivers.files.exports.as_applied import AsApplied
    from topdress.drivers.files.prescriptions.map_choices import ImportedMap, RateChoice
    from topdress.drivers.files.read_log import RunLog

# More rates fill a terminal; a raster can have hundreds of rates.
MAX_SHOWN_RATES = 20


def convert_map(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            help=f"A prescription ({describe_able('read_map')}; tasks and shapefiles as folder or "
            "zip too; points of even cells), or a run log (.csv).",
        ),
    ],
    *,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT",
            help=f"By its ending: {describe_endings('write_map')} (ISOXML task); of a run log "
            f"{describe_endings('write_export')} (ISOXML task), and .html (the job's report). "
            "Without it: only a summary of IN.",
        ),
    ] = None,
    column: Annotated[
        str | None, typer.Option(metavar="NAME", help="Rate column of a shapefile, GeoJSON or CSV.")
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(metavar="UNIT", help="Of that column: kg/ha, l/ha, lb/ac, kg N/ha, ..."),
    ] = None,
    scale: Annotated[float, typer.Option(metavar="FACTOR", help="Factor on every rate.")] = 1.0,
    density: Annotated[
        float | None, typer.Option(metavar="KG_PER_L", help="Of the product, for rates in volumes.")
    ] = None,
    nitrogen: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="N in the product, 0 to 1, for rates of nitrogen and for what a run log applied.",
        ),
    ] = None,
    default: Annotated[
        float | None,
        typer.Option(metavar="KG_HA", help="Inside the field where the map says nothing."),
    ] = None,
    outside: Annotated[
        float | None, typer.Option(metavar="KG_HA", help="Outside the field or the map.")
    ] = None,
    lost: Annotated[
        float | None, typer.Option(metavar="KG_HA", help="When the position is lost.")
    ] = None,
    layer: Annotated[
        str | None,
        typer.Option(
            metavar="LAYER", help="Of a task file with several: TASK/DDI or TASK/DDI/PRODUCT."
        ),
    ] = None,
    inside: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Of a zip or folder with several: the task set or shapefile."
        ),
    ] = None,
    zone: Annotated[
        str | None,
        typer.Option(metavar="ZONE", help="Of a table of places in metres: its UTM zone, as 32N."),
    ] = None,
    rate_from: Annotated[
        str | None,
        typer.Option(
            metavar="ddi|presentation", help="Where a task file contradicts itself about its unit."
        ),
    ] = None,
    rule: Annotated[
        str | None,
        typer.Option(
            metavar="JOB",
            help="IN holds the canopy's index (NDVI): rates by the rule of this job's crop.",
        ),
    ] = None,
    machine: Annotated[
        str | None,
        typer.Option(
            metavar="MACHINE",
            help="Of a run log without its NAME.yaml; of a fine raster, for its working width.",
        ),
    ] = None,
    product: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the product, instead of the log's.")
    ] = None,
    every: Annotated[
        float, typer.Option(metavar="S", help="Longest stretch of an as-applied export, s.")
    ] = 1.0,
    polygons: Annotated[
        bool, typer.Option("--polygons", help="As-applied as ground covered, not points.")
    ] = False,
    merge: Annotated[
        float | None,
        typer.Option(
            metavar="KG_HA",
            help="Zones whose rates differ by no more than this step become one; the mass stays.",
        ),
    ] = None,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Read a prescription and convert it, or export what a run log applied."""
    from topdress.drivers.files.file_content import FileContent
    from topdress.drivers.files.file_sniffer import TABLE_SUFFIXES
    from topdress.drivers.files.prescriptions.map_choices import RateChoice

    # A file of another kind, e.g. a machine file, gets a message with the command that reads it.
    refuse_other_kinds([source], MAP_FILE_KINDS)
    # An ISOXML export into the folder of IN would overwrite the task set that is read.
    if out is not None and out.resolve() in (source.resolve(), source.resolve().parent):
        raise CommandError(f"--out {out}: allowed is another place than IN's")
    holds = FileContent(source).content_kind
    # An empty file has no content to recognise, so its suffix decides.
    is_log = holds in ("log", "table") or (not holds and source.suffix.lower() in TABLE_SUFFIXES)
    if out is not None:
        # The check precedes the reading, because a large map takes seconds.
        refuse_collisions(_list_read_files(source, is_log, machine), [_make_output(out)], force)
    if is_log:
        _export_log(
            source,
            out,
            machine=machine,
            product=product,
            nitrogen=nitrogen,
            every_s=every,
            polygons=polygons,
            as_json=as_json,
        )
        return
    choice = RateChoice(
        column=column,
        unit=unit,
        scale=scale,
        density_kg_l=density,
        n_fraction=nitrogen,
        default_kg_ha=default,
        outside_kg_ha=outside,
        lost_kg_ha=lost,
        layer=layer,
        inside=inside,
        zone=zone,
        rate_from=_check_rate_source(rate_from),
        # The width decides how far a fine raster is averaged.
        width_m=None if machine is None else load_machine(machine).geometry.working_width_m,
    )
    _convert_prescription(source, out, choice, rule, merge, as_json)


def _list_read_files(source: Path, is_log: bool, machine: str | None) -> tuple[Path, ...]:
    from topdress.drivers.files.archives import list_opened_files
    from topdress.drivers.files.file_content import FileContent

    # A run log consists of the CSV and its NAME.yaml; a map may consist of several files of an
    # archive.
    own = (
        list_log_files(source)
        if is_log and FileContent(source).is_table
        else list_opened_files(source)
    )
    return (*own, *(() if machine is None else (find_machine_file(machine),)))


def _make_output(out: Path) -> Output:
    """Returns the files written at `out`, by its suffix; an earlier export in a format that names
    its program is recognised."""
    from topdress.console.reports.html import GENERATOR_META

    # Formats that store the program's name can replace an earlier export of topdress without
    # --force.
    match out.suffix.lower():
        case ".shp":
            return Output(
                tuple(
                    # A shapefile is a set of files with one stem.
                    out.with_suffix(ending)
                    for ending in (".shp", ".shx", ".dbf", ".prj", ".cpg")
                )
            )
        case ".html":
            return make_marked_output(out, GENERATOR_META.encode())
        case ".geojson" | ".json":
            return make_marked_output(out, b'"topdress": {"format": "topdress-')
        # An ISOXML task set is a folder; its path may be given as the folder or as TASKDATA.XML.
        case ".xml" | "":
            folder = out.parent if out.suffix else out
            return make_marked_output(
                folder / "TASKDATA.XML",
                b'Manufacturer="topdress"',
                [folder / name for name in ("GRD00001.bin", "TLG00001.xml", "TLG00001.bin")],
            )
    return Output((out,))


def _check_rate_source(text: str | None) -> Literal["ddi", "presentation"] | None:
    if text not in (None, "ddi", "presentation"):
        raise CommandError(f"--rate-from {text}: allowed ddi, presentation")
    return text  # type: ignore[return-value]


def _convert_prescription(
    source: Path,
    out: Path | None,
    choice: RateChoice,
    job: str | None,
    merge_kg_ha: float | None,
    as_json: bool,
) -> None:
    from topdress.control.recordings.finding import Finding
    from topdress.drivers.files.prescriptions.map_reader import (
        apply_canopy_rule,
        choose_index_column,
        merge_map_zones,
        read_prescription,
    )
    from topdress.drivers.files.prescriptions.map_writer import describe_losses, write_prescription

    if job is None:
        # A prescription without a rule already contains rates.
        read = read_prescription(source, choice)
    # a map of an index, as rates by the rule of a job's crop
    else:
        from topdress.drivers.files.run_setup import load_setup

        # Only the rule of this setup is used, and any machine gives it; --machine serves the
        # raster's width.
        rule = load_setup("huanghai", job, day_clock.read_today()).rule
        read = apply_canopy_rule(
            read_prescription(source, choose_index_column(choice, rule, job)), rule
        )
    # Zones are merged after the rule, because the step is in kg/ha.
    if merge_kg_ha is not None:
        read = merge_map_zones(read, merge_kg_ha)
    if out is not None:
        if find_writer(out, "write_map") is None:
            raise CommandError(f"--out {out}: allowed {describe_endings('write_map')}")
        # The format is checked before the folder is made, so a typing error leaves no empty folder.
        out.parent.mkdir(parents=True, exist_ok=True)
        write_prescription(read.data, out)
        # Some formats cannot store fallback rates or holes; the operator must learn what was lost.
        if lost := describe_losses(read.data, out):
            read = replace(read, findings=(*read.findings, Finding("not_written", lost)))
    _print_prescription(read, as_json)
    if out is not None and not as_json:
        typer.echo(f"written      {out}")


def _print_prescription(read: ImportedMap, as_json: bool) -> None:
    from topdress.console.app.pages.job.map_words import describe_map_check
    from topdress.console.app.units import METRIC
    from topdress.control.recordings.finding import many
    from topdress.control.targets.map_check import check_map
    from topdress.control.targets.prescription import calc_rate_shares

    shares = calc_rate_shares(read.data)
    # An area can be zero for a map of points; the mean below guards against it.
    area, mass = sum(s.area_ha for s in shares), sum(s.mass_kg for s in shares)
    grid = read.data.grid
    if as_json:
        print_json(
            {
                "path": read.path,
                "format": read.format,
                "rate_from": read.rate_from,
                "unit": read.unit,
                "unit_from": read.unit_from,
                "kg_ha_per_unit": read.factor,
                "layers": read.layers,
                "zones": len(read.data.zones),
                "cells": None if grid is None else grid.rate_kg_ha.shape,
                "product": read.data.product,
                "fallbacks": read.data.fallbacks,
                "area_ha": area,
                "mass_kg": mass,
                "check": check_map(read.data),
                "rates": shares,
                "findings": read.findings,
            }
        )
        return
    size = (
        many(len(read.data.zones), "zone")
        if grid is None
        else "{} x {} cells".format(*grid.rate_kg_ha.shape)
    )
    typer.echo(
        f"{read.format:12} {size}, numbers in {read.unit}"
        + (f", {read.data.product}" if read.data.product else "")
    )
    typer.echo(f"rates        {read.rate_from}; {read.unit} {read.unit_from}")
    fallbacks = read.data.fallbacks
    typer.echo(
        f"elsewhere    {fallbacks.default_kg_ha:g} kg/ha in the field, "
        f"{fallbacks.outside_kg_ha:g} outside, "
        f"{fallbacks.lost_kg_ha:g} with the position lost"
    )
    for share in shares[:MAX_SHOWN_RATES]:
        typer.echo(
            f"{share.rate_kg_ha:9.2f} kg/ha {share.area_ha:10.4f} ha {share.mass_kg:10.2f} kg"
        )
    # The number of omitted rates is printed, since a cut list would look complete.
    if len(shares) > MAX_SHOWN_RATES:
        typer.echo(f"          ... {len(shares) - MAX_SHOWN_RATES} more rates")
    typer.echo(
        f"altogether   {area:.4f} ha, {mass:.2f} kg, mean {mass / area if area else 0.0:.2f} kg/ha"
    )
    for text in (
        *(finding.text for finding in read.findings),
        *describe_map_check(check_map(read.data), METRIC),
    ):
        typer.echo(f"note         {text}")


def _export_log(
    source: Path,
    out: Path | None,
    *,
    machine: str | None,
    product: str | None,
    nitrogen: float | None,
    every_s: float,
    polygons: bool,
    as_json: bool,
) -> None:
    from topdress.drivers.files.any_log import open_any_log
    from topdress.drivers.files.exports.as_applied import SpreadProduct, build_as_applied
    from topdress.drivers.files.exports.export_columns import summarise_export
    from topdress.drivers.files.exports.export_writer import write_as_applied

    given = None
    # An option replaces the log's product; without options the log's own product applies.
    if product is not None or nitrogen is not None:
        given = SpreadProduct(product or "product", nitrogen or 0.0)
    log = open_any_log(source)
    loaded = load_machine(machine) if machine else None
    applied = build_as_applied(log, loaded, given, every_s)
    # The report draws fewer segments than the data file has rows, so that a browser can open it.
    if out is not None and out.suffix.lower() == ".html":
        from topdress.console.reports.job_page import MAX_DRAWN_SEGMENTS

        _write_job_report(
            build_as_applied(
                log, loaded, given, max(every_s, applied.totals.worked_s / MAX_DRAWN_SEGMENTS)
            ),
            out,
            log,
        )
    elif out is not None:
        write_as_applied(applied, out, polygons)
    if as_json:
        print_json(summarise_export(applied))
        # A summary without --out is the purpose of the command, so this is no error.
        return
    _print_applied(applied)
    if out is not None:
        typer.echo(f"written      {out}")


def _write_job_report(applied: AsApplied, out: Path, log: RunLog) -> None:
    from topdress.console.reports.job_metadata import read_job_metadata
    from topdress.console.reports.job_page import make_job_page
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.run_meta import find_software_version

    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(
        out, make_job_page(applied, f"topdress {find_software_version()}", read_job_metadata(log))
    )


def _print_applied(applied: AsApplied) -> None:
    t = applied.totals
    typer.echo(
        f"applied      {t.applied_kg:.2f} kg of {applied.product.name} "
        f"({t.applied_n_kg:.2f} kg N) on "
        f"{applied.worked_ha:.4f} ha, mean {applied.mean_kg_ha:.1f} kg/ha"
    )
    # A job without a target, e.g. a manual one, has no deviation from the target.
    error = "" if t.error_percent is None else f", applied {t.error_percent:+.2f} %"
    typer.echo(f"target       {t.target_kg:.2f} kg{error}")
    if (cut := applied.cut) is not None:
        typer.echo(
            f"limit        {cut.area_ha:.4f} ha wanted up to {cut.highest_kg_ha:g} kg/ha: "
            "the crop's limit of "
            f"{cut.limit_kg_ha:g} was applied there, {cut.less_kg:.2f} kg less than wanted"
        )
    if t.stopped_kg >= 0.005:  # less would be written as 0.00
        typer.echo(
            f"stopped      {t.stopped_kg:.2f} kg of it were released while the shaft should "
            "have stood"
        )
    typer.echo(f"stretches    {len(applied.stretches.time_s)} in {t.worked_s:.0f} s of work")
