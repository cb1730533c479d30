"""How does `topdress field` convert outlines, obstacles and guidance lines of other programs to the
job's field, and back?
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from topdress.console.cli.inputs import AcceptedKinds, refuse_other_kinds, require_suffix
from topdress.console.cli.outputs import ForceOption, Output, find_named_file, refuse_collisions
from topdress.console.cli.plain_errors import CommandError, print_note_lines
from topdress.console.cli.plain_output import AsJson, print_json
from topdress.drivers.files.formats.registry import (
    describe_able,
    describe_endings,
    find_writer,
    list_able,
    list_endings,
    list_kinds,
)

# Type checking only: the readers of shapes load their libraries when a file is read.
if TYPE_CHECKING:
    from topdress.drivers.files.fields.field_data import FieldData

# Distance of worked ground from the job's field beyond which it belongs to another field, m.
# A kilometre exceeds any field's length, so such ground was surely chosen by mistake.
MAX_GROUND_DISTANCE_M = 1000.0
FIELD_KINDS = AcceptedKinds(
    (*list_kinds("read_layers", "read_field"), "config"),
    f"a field ({describe_able('read_layers', 'read_field')}; tasks and shapefiles as folder or zip "
    "too), or a job file",
)

DONE_KINDS = AcceptedKinds(
    (*FIELD_KINDS.kinds, "text"), f"{FIELD_KINDS.words}, or Sections.txt of AgOpenGPS"
)


def convert_field(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            help=f"{FIELD_KINDS.words[0].upper()}{FIELD_KINDS.words[1:]}.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT",
            help="By its ending: .yaml (a job with this field), "
            f"{describe_endings('write_field')} (AgOpenGPS). Without it: only a summary of IN.",
        ),
    ] = None,
    job: Annotated[
        str,
        typer.Option(
            metavar="JOB",
            help="Of a .yaml: the job that gets the field, or the name of a "
            "shipped one; it stays as it is.",
        ),
    ] = "demo",
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of IN with several fields.")
    ] = None,
    line: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Of several guidance lines: the one whose heading the passes have."
        ),
    ] = None,
    done: Annotated[
        bool,
        typer.Option(
            "--done",
            help="What AgOpenGPS marked as worked (Sections.txt), or the polygons "
            "of IN, as ground that is done: the job spreads nothing there again.",
        ),
    ] = False,
    largest: Annotated[
        bool,
        typer.Option(
            "--largest",
            help="Of an outline that crosses itself: the largest part that it encloses.",
        ),
    ] = False,
    as_json: AsJson = False,
    force: ForceOption = False,
) -> None:
    """Take a field's outline, obstacles, guidance lines and headland into a job, or write a
    job's field for others."""
    refuse_other_kinds([source], DONE_KINDS if done else FIELD_KINDS)
    require_suffix("--out", out, ".yaml", ".yml", *list_endings("write_field"))
    is_job = out is not None and out.suffix.lower() in (".yaml", ".yml")
    if out is not None:
        from topdress.drivers.files.config_kinds import JOB_KIND

        reads = [
            # AgOpenGPS stores a field as a folder of files; each of them is an input.
            *(source.iterdir() if source.is_dir() else [source]),
            # The job that is read must not be overwritten by the job that is written.
            *([find_named_file(job, JOB_KIND.folder)] if is_job else []),
        ]
        files = (
            (out,)
            if out.suffix
            # These names are those that AgOpenGPS reads.
            else tuple(out / one for one in ("Field.txt", "Boundary.txt", "TrackLines.txt"))
        )
        refuse_collisions(reads, [Output(files)], force)
    if done:
        _add_done_ground(source, out, job, as_json)
        return
    from topdress.drivers.files.fields.field_data import repair_outline

    # A crossing outline has no defined area; --largest selects the part to keep.
    data = repair_outline(_read_field(source, name), source, largest)
    print_note_lines(data.findings, f"{source}: ")
    _print_field(data, as_json)
    # A summary without --out is the purpose of the command, so this is no error.
    if out is None:
        return
    out.parent.mkdir(parents=True, exist_ok=True)
    if is_job:
        _write_job_field(data, job, line, out, source)
    else:
        found = find_writer(out, "write_field")
        assert found is not None and found.write_field is not None
        found.write_field(data, out)
    typer.echo(f"written      {out}", err=as_json)


def _read_field(source: Path, name: str | None) -> FieldData:
    from topdress.drivers.files.fields.field_data import build_field_data
    from topdress.drivers.files.fields.shapes import read_field_shapes
    from topdress.drivers.files.file_sniffer import sniff_file_kind

    # A folder may also hold a shapefile or a task set, so its content decides.
    kind = sniff_file_kind(source).id
    for one in list_able("read_field"):
        if one.id == kind and one.read_field is not None:
            return one.read_field(source)
    if source.suffix.lower() in (".yaml", ".yml"):
        from topdress.drivers.files.config import load_config
        from topdress.drivers.files.config_kinds import JOB_KIND

        return build_field_data(load_config(source, JOB_KIND).model.field, str(source))
    return read_field_shapes(source, name)


def _write_job_field(data: FieldData, job: str, line: str | None, out: Path, source: Path) -> None:
    from topdress.drivers.files.config import load_config, save_config
    from topdress.drivers.files.config_kinds import JOB_KIND
    from topdress.drivers.files.fields.field_data import build_job_ground

    loaded = load_config(job, JOB_KIND)
    # Files that the job names are relative to its folder; the new job lies elsewhere.
    model = loaded.model.rename_files(lambda name: str((loaded.path.parent / name).resolve()))
    new = model.model_copy(update={"field": build_job_ground(data, model.field, line)})
    save_config(out, new, JOB_KIND, f"From {loaded.path.name}, its field from {source.name}")


def _add_done_ground(source: Path, out: Path | None, job: str, as_json: bool) -> None:
    """Writes worked ground into a job as a file name, because the file is read again at
    each start."""
    from topdress.control.geodesy import TangentPlane
    from topdress.drivers.files.config import load_config, save_config
    from topdress.drivers.files.config_kinds import JOB_KIND
    from topdress.drivers.files.fields.worked_area import read_worked_area

    if out is not None and out.suffix.lower() not in (".yaml", ".yml"):
        raise CommandError(
            f"--out {out}: allowed with --done is a job, a name that ends in .yaml or .yml"
        )
    loaded = load_config(job, JOB_KIND)
    ground = loaded.model.field
    has_field = bool(ground.boundary_m) and out is not None
    # Without a field the ground has a plane of its own, which is enough for its area.
    plane = TangentPlane(ground.origin_lat_deg, ground.origin_lon_deg) if has_field else None
    found = read_worked_area(source, plane)
    if as_json:
        print_json({"done_ha": found.area_ha})
    else:
        typer.echo(f"done         {found.area_ha:.4f} ha, each place once: gets nothing more")
    boundary = ground.make_boundary()
    if (
        plane is not None
        and boundary is not None
        # Ground far away is noted and not refused: the field's outline may be the wrong one.
        and (away_m := boundary.calc_distance_m(found.middle_m)) > MAX_GROUND_DISTANCE_M
    ):
        print_note_lines(
            [f"lies {away_m / 1000.0:.1f} km from the field of {loaded.path.name}"], f"{source}: "
        )
    if out is None:
        return
    model = loaded.model.rename_files(lambda name: str((loaded.path.parent / name).resolve()))
    new = model.model_copy(
        # The whole path is stored, because the job may be moved.
        update={"field": model.field.model_copy(update={"done": str(source.resolve())})}
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    save_config(out, new, JOB_KIND, f"From {loaded.path.name}, done ground from {source.name}")
    typer.echo(f"written      {out}", err=as_json)


def _print_field(data: FieldData, as_json: bool) -> None:
    from topdress.drivers.files.plain_data import convert_to_plain

    boundary = data.boundary(data.plane())
    if as_json:
        print_json(
            {"area_ha": None if boundary is None else boundary.area_ha, **convert_to_plain(data)}
        )
        return
    if boundary is not None and data.outline_deg is not None:
        holes = f", {len(data.holes_deg)} obstacles taken out" if data.holes_deg else ""
        typer.echo(
            f"field        {data.title}: {boundary.area_ha:.4f} ha, {len(data.outline_deg)} "
            f"corners{holes}"
        )
    for one in data.lines:
        # Two places define a straight line; more are a curve.
        kind = "line" if len(one.places_deg) == 2 else f"curve of {len(one.places_deg)} places"
        typer.echo(f"guidance     {one.title}: {kind}")
    if data.headland_m is not None:
        typer.echo(f"headland     {data.headland_m:.2f} m")
