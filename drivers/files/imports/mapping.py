"""How does an import file "topdress-import/1" describe the columns of a foreign log? docs/import.md
explains the keys.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal
from zoneinfo import ZoneInfo, available_timezones

from pydantic import Field, model_validator
from topdress.control.frozen_model import FrozenModel
from topdress.control.log_row import COLUMNS, TEXT_COLUMNS, WHOLE_COLUMNS
from topdress.drivers.files.config import ConfigKind
from topdress.drivers.files.config_words import suggest_nearest
from topdress.drivers.files.imports.units import KNOWN_UNITS, find_named_unit, find_quantity

# Column of a run log with its events.
EVENTS_COLUMN = "events"
# Prefix of columns beyond the log's own (docs/format-run-log.md).
EXTRA_COLUMN_PREFIX = "x_"
_EXTRA_NAME = re.compile(r"^x_\w+$")
# This column is made from the times of the file, so no key names it.
UNMAPPED_COLUMNS = frozenset({"time_s"})
# Column of the log that `working` fills.
STATE_COLUMN = "state"

Delimiter = Literal[",", ";", "tab", "|", "blank"]
CountedTimeUnit = Literal[
    "text",
    "s",
    "ms",
    "us",
    "min",
    "h",
    "unix_s",
    "unix_ms",
    "unix_us",
    "unix_ns",
    "excel_day",
    "rows",
]
SourceKind = Literal["text", "excel", "geojson", "shapefile", "isoxml", "parquet"]
Name = Annotated[str, Field(min_length=1)]
MissingMarks = tuple[float | str, ...]


class Source(FrozenModel):
    """Description of the file's reading; omitted keys are detected from the file."""

    kind: SourceKind | None = None
    encoding: Name | None = None
    delimiter: Delimiter | None = None
    decimal: Literal[".", ","] | None = None
    title_rows: Annotated[
        int | None, Field(ge=0, le=1000, description="lines before the header")
    ] = None
    unit_row: Annotated[
        bool | None, Field(description="whether the row below the header holds units")
    ] = None
    names: Annotated[
        tuple[Name, ...] | None, Field(description="the columns of a file without a header")
    ] = None
    sheet: Name | None = None
    inside: Annotated[
        Name | None, Field(description="of a zip or folder with several task sets or shapefiles")
    ] = None
    task: Annotated[
        Name | None, Field(description="of a task set with several, its id or title: TSK1")
    ] = None
    device: Annotated[
        Name | None, Field(description="of a task set with several, its id or name: DVC1")
    ] = None
    task_log: Annotated[
        Name | None, Field(description="one time log of a task set, e.g. TLG00001")
    ] = None
    values_from: Annotated[
        Literal["ddi", "presentation"] | None,
        Field(
            description="where a task set's device contradicts the data dictionary on what a rate "
            "is worth"
        ),
    ] = None


class Times(FrozenModel):
    """Description of the column with the time, and of its format."""

    column: Name | None = None
    date_column: Annotated[
        Name | None, Field(description="the day, where column holds the time of day only")
    ] = None
    counts: CountedTimeUnit = "text"
    format: Annotated[
        Name | None, Field(description="of texts, as strptime has it; left out: ISO 8601")
    ] = None
    zone: Annotated[
        Name | None, Field(description="of local times: Europe/Berlin, UTC, +08:00")
    ] = None
    step_s: Annotated[
        float | None,
        Field(gt=0.0, le=3600.0, json_schema_extra={"unit": "s"}, description="with counts: rows"),
    ] = None

    @model_validator(mode="after")
    def _check_times_fit(self) -> Times:
        if self.counts == "rows" and (self.step_s is None or self.column is not None):
            raise ValueError("time: counts rows: allowed with step_s and without a column")
        if self.counts != "rows" and self.column is None:
            raise ValueError(
                "time: no column: allowed is a column of the file, or counts: rows with step_s"
            )
        if self.counts != "rows" and self.step_s is not None:
            raise ValueError(f"time.step_s {self.step_s:g}: allowed with counts: rows only")
        if self.format is not None and self.counts != "text":
            raise ValueError(f"time.format {self.format}: allowed with counts: text only")
        if self.zone is not None and not is_time_zone(self.zone):
            raise ValueError(
                f"time.zone {self.zone}: allowed a name such as Europe/Berlin, UTC, or an "
                "offset such as "
                f"+08:00{suggest_nearest(self.zone, available_timezones())}"
            )
        return self


class Column(FrozenModel):
    """One column of the log: sign x (number x scale + offset), in `unit`."""

    source: Annotated[Name | None, Field(alias="from", description="column of the file")] = None
    constant: Annotated[
        float | None, Field(description="in the place of a column, in the log's unit")
    ] = None
    unit: Annotated[Name | None, Field(description="of scaled numbers; left out: the log's")] = None
    scale: float = 1.0
    offset: float = 0.0
    sign: Literal[1, -1] = 1
    full: Annotated[
        float | None, Field(gt=0.0, description="with unit %: 100 % in the log's unit")
    ] = None
    missing: Annotated[
        MissingMarks, Field(description="numbers or texts that stand for not known")
    ] = ()
    valid: Annotated[
        tuple[float, float] | None,
        Field(description="lowest and highest number of the file that can be"),
    ] = None

    @classmethod
    def from_source(
        cls, source: str, unit: str | None = None, missing: MissingMarks = ()
    ) -> Column:
        """Returns a column of the file, as `from` names it."""
        return cls.model_validate({"from": source, "unit": unit, "missing": missing})

    @model_validator(mode="after")
    def _check_one_origin(self) -> Column:
        """Checks that a column has exactly one origin, and its numbers."""
        if (self.source is None) == (self.constant is None):
            raise ValueError("from, constant: allowed is one of them")
        if self.scale == 0.0:
            raise ValueError("scale 0: allowed is any other number")
        if self.valid is not None and self.valid[0] >= self.valid[1]:
            raise ValueError(
                f"valid {self.valid[0]:g}, {self.valid[1]:g}: allowed the lowest before the highest"
            )
        if self.unit is not None and find_named_unit(self.unit) is None:
            raise ValueError(
                f"unit {self.unit}: not known; allowed e.g. km/h, r/min, mm, kg/ha (all: "
                "docs/import.md)"
            )
        return self


class Working(FrozenModel):
    """Condition for working: `state` of the log is working where it is true, else ready."""

    column: Name
    equals: tuple[float | str, ...] = ()
    above: float | None = None
    below: float | None = None

    @model_validator(mode="after")
    def _check_condition(self) -> Working:
        """Checks that exactly one kind of condition is given."""
        if not self.equals and self.above is None and self.below is None:
            raise ValueError("working: no condition: allowed are equals, above, below")
        if self.equals and (self.above is not None or self.below is not None):
            raise ValueError("working: equals with above or below: allowed is one of the two")
        return self


class Join(FrozenModel):
    """Rule for joining several files into one log."""

    order: Annotated[
        Literal["clock", "runs"] | None,
        Field(
            description="clock: by their times; runs: one after the other; left out: clock where "
            "times allow it"
        ),
    ] = None
    gap_s: Annotated[float, Field(gt=0.0, le=86_400.0, json_schema_extra={"unit": "s"})] = 60.0


class ImportFile(FrozenModel):
    """Import file "topdress-import/1"."""

    source: Source = Source()
    time: Times
    columns: Annotated[
        dict[str, Column],
        Field(
            description="log column -> where it comes from; names beyond the "
            f"log's own begin with {EXTRA_COLUMN_PREFIX}"
        ),
    ]
    working: Working | None = None
    rows: Annotated[
        Literal["answer_next_row", "answer_in_row"],
        Field(description="answer_in_row: a row holds a command and what it settled at"),
    ] = "answer_next_row"
    missing: Annotated[MissingMarks, Field(description="stand for not known in every column")] = ()
    width_m: Annotated[
        float | None,
        Field(
            gt=0.0,
            le=100.0,
            json_schema_extra={"unit": "m"},
            description="working width, for rates given as a flow of mass",
        ),
    ] = None
    density_kg_l: Annotated[
        float | None,
        Field(
            gt=0.0,
            le=5.0,
            json_schema_extra={"unit": "kg/l"},
            description="of the product, for rates given as a volume",
        ),
    ] = None
    extra: Annotated[
        Literal["keep", "drop"], Field(description="columns that nothing here names")
    ] = "keep"
    join: Join = Join()

    @model_validator(mode="after")
    def _check_log_columns(self) -> ImportFile:
        for name, column in self.columns.items():
            _check_column_name(name)
            _check_column_unit(name, column, self.width_m, self.density_kg_l)
        if self.working is not None and STATE_COLUMN in self.columns:
            raise ValueError("working: columns.state stands there too: allowed is one of them")
        return self


IMPORT_KIND = ConfigKind("topdress-import/1", "imports", ImportFile)


def is_time_zone(name: str) -> bool:
    """Returns whether a text names a time zone or an offset from UTC such as +08:00."""
    if re.fullmatch(r"[-+](0\d|1[0-4]):[0-5]\d", name):
        return True
    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        return False
    return True


def _check_column_name(name: str) -> None:
    """Refuses a name that is no column of a log. Raises ValueError."""
    if name in UNMAPPED_COLUMNS:
        raise ValueError(
            f"columns.{name}: made from the times of the file: allowed is the key time"
        )
    if name not in COLUMNS and not _EXTRA_NAME.match(name):
        raise ValueError(
            f"columns.{name}: no column of a run log: allowed are those of "
            "docs/format-run-log.md, and "
            f"names that begin with {EXTRA_COLUMN_PREFIX}{suggest_nearest(name, COLUMNS)}"
        )


# Quantities from which a rate is computed with another number.
DERIVED_RATE_QUANTITIES = ("flow", "volume")


def _check_column_unit(
    name: str, column: Column, width_m: float | None, density_kg_l: float | None
) -> None:
    """Refuses a unit that does not fit its column. Raises ValueError."""
    where = f"columns.{name}"
    if name in TEXT_COLUMNS and (column.constant is not None or column.unit is not None):
        raise ValueError(f"{where}: a column of texts: allowed is from alone")
    unit = find_named_unit(column.unit) if column.unit is not None else None
    quantity = find_quantity(name)
    if column.full is not None and (unit is None or unit.name != "%"):
        raise ValueError(f"{where}.full {column.full:g}: allowed with unit % only")
    if unit is None or name.startswith(EXTRA_COLUMN_PREFIX):
        return
    if unit.name == "%" and quantity != "share":
        if column.full is None and name not in WHOLE_COLUMNS and quantity is not None:
            raise ValueError(
                f"{where}: unit %: allowed with full, what 100 % is in the log's unit"
                + (" (of a slope: unit slope %)" if quantity == "angle" else "")
            )
        return
    if quantity == "rate" and unit.quantity in DERIVED_RATE_QUANTITIES:
        if unit.quantity == "flow" and width_m is None:
            raise ValueError(
                f"{where}.unit {column.unit}: a flow: allowed with width_m, the working width"
            )
        if unit.quantity == "volume" and density_kg_l is None:
            raise ValueError(
                f"{where}.unit {column.unit}: a volume: allowed with density_kg_l, the "
                "product's density"
            )
        return
    if unit.quantity != quantity:
        allowed = ", ".join(one.name for one in KNOWN_UNITS if one.quantity == quantity) or "none"
        raise ValueError(f"{where}.unit {column.unit}: allowed {allowed}")
