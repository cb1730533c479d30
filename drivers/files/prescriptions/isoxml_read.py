"""How are ISO 11783-10 task files, versions 3 and 4, read? Treatment zones, grids of type 1 and 2,
and fallback zones are supported.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from topdress.control.recordings.finding import Finding, many
from topdress.control.targets.prescription import Fallbacks, GridDeg, MapData, Zone
from topdress.control.targets.rate_map import Floats
from topdress.drivers.files.imports.units import find_named_unit
from topdress.drivers.files.prescriptions.data_dictionary import describe_ddi
from topdress.drivers.files.prescriptions.map_choices import (
    MAX_RATE_KG_HA,
    RATE_UNITS,
    ImportedMap,
    PrescriptionError,
    RateChoice,
    RateQuestion,
    apply_fallback_choice,
    calc_factor_kg_ha,
    check_rate_kg_ha,
)
from topdress.drivers.files.prescriptions.task_files import TaskSet, read_task_tree
from topdress.drivers.files.shape_sets import sort_rings
from topdress.drivers.plain_text import PlaceInFile, Reason

# Unit of an identifier's numbers, and the size of a step in this unit (ISO 11783-11).
SETPOINT_STEPS = {1: ("mm3/m2", 0.01), 6: ("mg/m2", 1.0)}
# Quantities of the same identifiers, for messages.
SETPOINT_QUANTITIES = {1: "volume per area", 6: "mass per area"}
# Types of a polygon's lines (LSG): outline and hole.
EXTERIOR_LINE, INTERIOR_LINE = "1", "2"


class _TaskLayer(NamedTuple):
    """Holds a layer: a task's process data of one identifier and one product."""

    task: Element
    ddi: int
    product: str

    @property
    def id(self) -> str:
        """The layer's id, as --layer accepts it: TASK/DDI or TASK/DDI/PRODUCT."""
        return "/".join(
            part for part in (self.task.get("A", ""), f"{self.ddi:04X}", self.product) if part
        )

    def find_process_data(self, zone: Element) -> Element | None:
        """Returns its process data (PDV) in a zone; None for a zone without them."""
        return next(
            (
                one
                for one in zone.findall("PDV")
                if int(one.get("A", "0"), 16) == self.ddi and one.get("C", "") == self.product
                # Two layers may share an identifier and differ in their product.
            ),
            None,
        )


def read_isoxml_map(files: TaskSet, path: Path, choice: RateChoice) -> ImportedMap:
    """Returns the prescription of a task file. Raises PrescriptionError."""
    root = read_task_tree(files)
    layer, ids = _choose_layer(root, files.label, choice)
    where = PlaceInFile(files.label).go_down("task {task}", task=layer.id)
    values = {
        _parse_whole_number(zone.get("A", ""), 10, where.go_down("zone code")): _read_zone_value(
            zone, layer, where
        )
        for zone in layer.task.findall("TZN")
    }
    # The meaning of the numbers is decided before any rate is computed.
    unit, factor, offset, findings = _find_number_meaning(root, layer, where, choice)
    rates = {
        code: None if value is None else (value + offset) * factor for code, value in values.items()
    }
    # An impossible rate is refused here, where its zone can be named.
    for code, rate in rates.items():
        if rate is not None:
            check_rate_kg_ha(rate, lambda code=code: where.go_down("zone {zone}", zone=code))  # type: ignore[misc]
    fallbacks = apply_fallback_choice(
        _read_fallbacks(layer.task, rates, where, findings), choice, where
    )
    fields = _read_field_outlines(root, layer.task, files.label, findings)
    product = next(
        (p.get("B", "") for p in root.findall("PDT") if p.get("A") == layer.product), layer.product
    )
    grid_element = layer.task.find("GRD")
    grid = None
    zones: tuple[Zone, ...] = ()
    # Unused parts are reported, because the user may have meant them.
    findings += _report_unused(layer, ids, grid_element is not None)
    # A grid takes precedence over polygons, as ISO 11783-10 defines.
    if grid_element is not None:
        grid = _read_grid_deg(
            files,
            grid_element,
            layer,
            rates=rates,
            factor=factor,
            offset=offset,
            where=where,
            findings=findings,
        )
    else:
        zones = _read_zones_deg(layer.task, rates, where)
    data = MapData(zones, grid, fallbacks, fields, layer.task.get("B", ""), product)
    return ImportedMap(path, "isoxml", data, unit, factor, ids, tuple(findings))


def _choose_layer(
    root: Element, label: str, choice: RateChoice
) -> tuple[_TaskLayer, tuple[str, ...]]:
    """Returns the layer that the operator chose, or the only layer, and the ids of all. Raises
    PrescriptionError."""
    layers: list[_TaskLayer] = []
    others: set[int] = set()
    for task in root.findall("TSK"):
        for variable in task.findall("TZN/PDV"):
            ddi = _parse_whole_number(
                variable.get("A", ""),
                16,
                PlaceInFile(label).go_down("task {task}: PDV A", task=task.get("A")),
            )
            layer = _TaskLayer(task, ddi, variable.get("C", ""))
            if ddi not in SETPOINT_STEPS:
                others.add(ddi)
            # Zones repeat their layer, and each layer is listed once.
            elif layer.id not in [known.id for known in layers]:
                layers.append(layer)
    ids = tuple(layer.id for layer in layers)
    if not layers:
        raise PrescriptionError(
            label,
            "only {ddis}: allowed are tasks with zones of DDI 0001 (volume per area) or "
            "0006 (mass per area)"
            if others
            else "no treatment zones: allowed are tasks with zones of DDI 0001 (volume per "
            "area) or 0006 (mass per area)",
            "; topdress field reads its fields" if root.find("PFD/PLN") is not None else "",
            ddis=", ".join(map(describe_ddi, sorted(others))),
        )
    # A single layer needs no choice.
    if choice.layer is None and len(layers) == 1:
        return layers[0], ids
    for layer in layers:
        if choice.layer == layer.id:
            return layer, ids
    # A wrong name is an error, a missing name is a question.
    raise (PrescriptionError if choice.layer else RateQuestion)(
        label,
        "layer {layer}: allowed {layers}" if choice.layer else "layer not chosen: allowed {layers}",
        layer=choice.layer,
        layers=", ".join(f"{one.id} ({SETPOINT_QUANTITIES[one.ddi]})" for one in layers),
    )


def _find_number_meaning(
    root: Element, layer: _TaskLayer, where: PlaceInFile, choice: RateChoice
) -> tuple[str, float, float, list[Finding]]:
    """Returns the unit of the numbers, kg/ha for a step, the offset of each number, and findings.

    The data dictionary defines the value of a number, and the file's own presentation (VPN) should
    agree. Where they contradict, a wrong guess is a wrong dose, so the operator must choose.
    """
    unit, step = SETPOINT_STEPS[layer.ddi]
    # The dictionary is the standard's own definition.
    by_ddi = calc_factor_kg_ha(choice, unit, where) * step
    named = {
        one.get("E")
        for zone in layer.task.findall("TZN")
        if (one := layer.find_process_data(zone)) is not None
    }
    for presentation in (one for one in root.findall("VPN") if one.get("A") in named):
        shown = find_named_unit(presentation.get("E", ""))
        # A presentation may show another quantity, which gives no contradiction.
        if shown is None or shown.name not in RATE_UNITS:
            continue
        scale = _parse_attribute(presentation, "C", where)
        offset = _parse_attribute(presentation, "B", where) if presentation.get("B") else 0.0
        by_shown = calc_factor_kg_ha(choice, shown.name, where) * scale
        # Presentations are rounded, so a difference of 1 % is no contradiction.
        if abs(by_shown - by_ddi) <= 0.01 * by_ddi and offset == 0.0:
            continue
        differs = Reason(
            "100 is {by_ddi:g} kg/ha by DDI {ddi} but, an offset of {offset:g} added, "
            "{shown:g} kg/ha as presented "
            "({presentation})"
            if offset
            else "100 is {by_ddi:g} kg/ha by DDI {ddi} but {shown:g} kg/ha as presented "
            "({presentation})",
            {
                "by_ddi": 100 * by_ddi / choice.scale,
                "ddi": f"{layer.ddi:04X}",
                "offset": offset,
                "shown": (100 + offset) * by_shown / choice.scale,
                "presentation": presentation.get("A"),
            },
        )
        # Both readings are plausible, and the wrong one is a wrong dose.
        if choice.rate_from is None:
            raise RateQuestion(
                where, "{shown}: rate source not chosen: allowed ddi, presentation", shown=differs
            )
        taken = Finding("presentation", f"{where}: {differs}: taken by {choice.rate_from}")
        if choice.rate_from == "presentation":
            return shown.name, by_shown, offset, [taken]
        return unit, by_ddi, 0.0, [taken]
    return unit, by_ddi, 0.0, []


def _report_unused(layer: _TaskLayer, ids: tuple[str, ...], has_grid: bool) -> list[Finding]:
    """Returns findings about parts of the task that are not used."""
    found = []
    drawn = [
        zone.get("A", "") for zone in layer.task.findall("TZN") if zone.find("PLN") is not None
    ]
    if has_grid and drawn:
        text = (
            f"{many(len(drawn), 'zone')} with a polygon next to the grid not used: the grid holds"
        )
        found.append(
            Finding("zones_beside_grid", f"{text} (zones {', '.join(drawn[:8])})", rows=len(drawn))
        )
    # Totals and measured values often accompany the set-points.
    others = sorted(
        {int(variable.get("A", "0"), 16) for variable in layer.task.findall("TZN/PDV")}.difference(
            SETPOINT_STEPS
        )
    )
    if others:
        said = ", ".join(map(describe_ddi, others))
        found.append(Finding("other_data", f"process data not used: {said}"))
    if len(ids) > 1:
        found.append(
            Finding(
                "other_layers",
                f"layers not used: {', '.join(one for one in ids if one != layer.id)}",
            )
        )
    return found


def _read_zone_value(zone: Element, layer: _TaskLayer, where: PlaceInFile) -> int | None:
    """Returns the layer's number in a zone; None for a zone without a number."""
    found = layer.find_process_data(zone)
    return (
        None
        if found is None
        else _parse_whole_number(
            found.get("B", ""), 10, where.go_down("zone {zone}: PDV B", zone=zone.get("A"))
        )
    )


def _read_fallbacks(
    task: Element, rates: dict[int, float | None], where: PlaceInFile, findings: list[Finding]
) -> Fallbacks:
    """Returns the rates outside of all zones, by the zones that the task names for them."""
    found = {}
    for field, attribute, name in (
        # Attributes of a task (TSK) that name those zones.
        ("default_kg_ha", "H", "default"),
        ("lost_kg_ha", "I", "position-lost"),
        ("outside_kg_ha", "J", "out-of-field"),
    ):
        text = task.get(attribute)
        # A missing fallback means 0 kg/ha, and the report says so.
        if text is None:
            findings.append(Finding(f"no_{field[:-6]}_zone", f"no {name} zone: 0 kg/ha there"))
            continue
        code = _parse_whole_number(text, 10, where.go_down("{key}", key=attribute))
        # A reference to a missing zone is a damaged file, not a rate of 0.
        if code not in rates:
            raise PrescriptionError(
                where,
                "{name} zone {zone}: allowed {zones}",
                name=name,
                zone=code,
                zones=_list_zone_codes(rates),
            )
        found[field] = rates[code] or 0.0
    return Fallbacks(**found)


def _read_zones_deg(
    task: Element, rates: dict[int, float | None], where: PlaceInFile
) -> tuple[Zone, ...]:
    """Returns the zones with a polygon and a rate. Raises PrescriptionError for a task without such
    zones."""
    zones = []
    for zone in task.findall("TZN"):
        code = int(zone.get("A", "0"))
        rate = rates[code]
        for polygon in zone.findall("PLN"):
            for rings in _read_rings_deg(polygon, where.go_down("zone {zone}", zone=code)):
                # Zones without a rate of this layer belong to another product.
                if rate is not None:
                    zones.append(Zone(rate, rings, zone.get("B", "")))
    if not zones:
        raise PrescriptionError(where, "neither a grid nor zones with a polygon and a rate")
    return tuple(zones)


def _read_field_outlines(
    root: Element, task: Element, label: str, findings: list[Finding]
) -> tuple[tuple[Floats, ...], ...]:
    """Returns outlines of the task's field; unusable outlines are omitted with a finding."""
    # This import is local, because most files contain no field.
    from topdress.control.field.boundary import Boundary

    outlines: list[tuple[Floats, ...]] = []
    for field in root.findall("PFD"):
        # Other fields in the file belong to other tasks.
        if field.get("A") != task.get("E"):
            continue
        for polygon in field.findall("PLN"):
            if polygon.get("A") == "1":
                outlines += _read_rings_deg(
                    polygon, PlaceInFile(label).go_down("field {field}", field=field.get("A"))
                )
    usable = []
    # A wrong outline must not prevent the use of the map.
    for rings in outlines:
        try:
            Boundary(
                *(
                    [(float(a), float(b)) for a, b in rings[0]],
                    [[(float(a), float(b)) for a, b in hole] for hole in rings[1:]],
                )
            )
            usable.append(rings)
        except ValueError as error:
            findings.append(Finding("field_outline", f"the field's outline was left out: {error}"))
    return tuple(usable)


def _read_rings_deg(polygon: Element, where: PlaceInFile) -> list[tuple[Floats, ...]]:
    """Returns a polygon's rings: outlines, each with its holes."""
    outer: list[Floats] = []
    inner: list[Floats] = []
    for line in polygon.findall("LSG"):
        if line.get("A") in (EXTERIOR_LINE, INTERIOR_LINE):
            (outer if line.get("A") == EXTERIOR_LINE else inner).append(_read_ring_deg(line, where))
    # The standard does not assign holes to outlines, so positions decide.
    return sort_rings(outer, inner)


def _read_ring_deg(line: Element, where: PlaceInFile) -> Floats:
    """Returns a line's corners (k, 2), latitude and longitude, not closed."""
    points = line.findall("PNT")
    if any(point.get("J") for point in points):
        raise PrescriptionError(
            where,
            "points in a binary file ({name}): allowed are points in the XML",
            name=points[0].get("J"),
        )
    corners = np.array(
        [
            (_parse_attribute(point, "C", where), _parse_attribute(point, "D", where))
            for point in points
        ]
    )
    # Some programs repeat the first point at the end.
    if len(corners) > 1 and (corners[0] == corners[-1]).all():
        corners = corners[:-1]
    if len(corners) < 3:
        raise PrescriptionError(where, "a ring of less than 3 corners: allowed 3 or more")
    return corners


def _read_grid_deg(
    files: TaskSet,
    grid: Element,
    layer: _TaskLayer,
    *,
    rates: dict[int, float | None],
    factor: float,
    offset: float,
    where: PlaceInFile,
    findings: list[Finding],
) -> GridDeg:
    """Returns the grid with its rates, from its binary file."""
    # The name of the binary file has no suffix in the task file.
    name, kind = f"{grid.get('G', '')}.bin", grid.get("I", "")
    columns, rows = (
        _parse_whole_number(grid.get(key, ""), 10, where.go_down("grid {key}", key=key))
        for key in ("E", "F")
    )
    cell_lat, cell_lon = (_parse_attribute(grid, key, where.go_down("grid")) for key in ("C", "D"))
    if not (rows > 0 and columns > 0 and cell_lat > 0.0 and cell_lon > 0.0):
        raise PrescriptionError(
            where,
            "grid of {rows} rows, {columns_across} columns, cell {lat:g} x {lon:g} deg: "
            "allowed is above 0",
            rows=rows,
            columns_across=columns,
            lat=cell_lat,
            lon=cell_lon,
        )
    # Data transfers are often copied without their binary files.
    data = files.read(name)
    if data is None:
        raise PrescriptionError(where, "{name}, which the grid names, is not there", name=name)
    if kind == "1":
        rate = _apply_code_table(
            _decode_cells(data, rows, columns, 1, np.dtype("u1"), name, where)[:, :, 0],
            rates,
            findings,
        )
    elif kind == "2":
        order = _read_cell_template(layer, grid, where)
        values = _decode_cells(data, rows, columns, len(order), np.dtype("<i4"), name, where)
        rate = (values[:, :, order.index((layer.ddi, layer.product))] + offset) * factor
        # The condition is written so that NaN counts as wrong.
        bad = np.argwhere(~((rate >= 0.0) & (rate <= MAX_RATE_KG_HA)))
        if len(bad):
            row, column = bad[0].tolist()
            check_rate_kg_ha(
                float(rate[row, column]),
                lambda: where.go_down(
                    "{name}: row {row}, column {column}", name=name, row=row, column=column
                ),
            )
    else:
        raise PrescriptionError(where, "grid type {kind}: allowed 1 and 2", kind=kind)
    return GridDeg(
        _parse_attribute(grid, "A", where),
        _parse_attribute(grid, "B", where),
        cell_lat,
        cell_lon,
        rate,
    )


def _decode_cells(
    data: bytes,
    rows: int,
    columns: int,
    depth: int,
    kind: np.dtype[np.generic],
    name: str,
    where: PlaceInFile,
) -> Floats:
    """Returns the numbers of a binary file (rows, columns, depth). Raises PrescriptionError where
    its size is wrong."""
    wanted = rows * columns * depth * kind.itemsize
    # A wrong size would shift every row of the grid.
    if len(data) != wanted:
        raise PrescriptionError(
            where,
            "{name}: {found} bytes: allowed {wanted} ({rows} rows, {columns_across} "
            "columns, {depth} x {item} "
            "bytes a cell)",
            name=name,
            found=len(data),
            wanted=wanted,
            rows=rows,
            columns_across=columns,
            depth=depth,
            item=kind.itemsize,
        )
    return np.frombuffer(data, dtype=kind).reshape(rows, columns, depth).astype(np.float64)


def _apply_code_table(
    codes: Floats, rates: dict[int, float | None], findings: list[Finding]
) -> Floats:
    """Returns the rates of a grid of codes; NaN for a code without a rate."""
    # A code is one byte.
    table = np.full(256, np.nan)
    for code, rate in rates.items():
        if rate is not None and 0 <= code < 256:
            table[code] = rate
    # Cells with unknown codes get no rate, and their number is reported.
    unknown = sorted(set(np.unique(codes).astype(int).tolist()) - set(rates))
    if unknown:
        count = int(np.isin(codes, unknown).sum())
        findings.append(
            Finding(
                "unknown_codes",
                f"{many(count, 'cell')} with codes that no zone has "
                f"({', '.join(map(str, unknown[:5]))}): without a rate",
                rows=count,
            )
        )
    return np.asarray(table[codes.astype(np.int64)], dtype=np.float64)


def _read_cell_template(
    layer: _TaskLayer, grid: Element, where: PlaceInFile
) -> list[tuple[int, str]]:
    """Returns the process data that a cell of a type 2 grid holds, in order."""
    code = grid.get("J")
    # The template zone defines the order of the values in each cell.
    for zone in layer.task.findall("TZN"):
        if zone.get("A") == code and layer.find_process_data(zone) is not None:
            return [(int(one.get("A", "0"), 16), one.get("C", "")) for one in zone.findall("PDV")]
    raise PrescriptionError(
        where,
        "grid of type 2 names zone {zone}: allowed is a zone with this layer's data",
        zone=code,
    )


def _list_zone_codes(rates: dict[int, float | None]) -> str:
    """Returns the codes of the first zones, for a message."""
    codes = sorted(rates)
    return ", ".join(map(str, codes[:8])) + (", ..." if len(codes) > 8 else "")


def _parse_whole_number(text: str, base: int, where: PlaceInFile) -> int:
    """Returns an integer. Raises PrescriptionError."""
    try:
        return int(text, base)
    except ValueError:
        raise PrescriptionError(
            where, "{value}: allowed is a whole number", value=repr(text)
        ) from None


def _parse_attribute(element: Element, attribute: str, where: PlaceInFile) -> float:
    """Returns a number within its attribute's range. Raises PrescriptionError."""
    text = element.get(attribute, "")
    try:
        value = float(text)
    except ValueError:
        raise PrescriptionError(
            where.go_down("{key}", key=f"{element.tag} {attribute}"),
            "{value}: allowed is a number",
            value=repr(text),
        ) from None
    # Latitudes and longitudes of points and grids, degrees.
    limit = {"PNT": {"C": 90.0, "D": 180.0}, "GRD": {"A": 90.0, "B": 180.0}}.get(
        element.tag, {}
    ).get(attribute)
    if not np.isfinite(value) or (limit is not None and abs(value) > limit):
        raise PrescriptionError(
            where.go_down("{key}", key=f"{element.tag} {attribute}"),
            "{value:g}: allowed a finite number"
            if limit is None
            else "{value:g}: allowed -{limit:g} to {limit:g}",
            value=value,
            limit=limit,
        )
    return value
