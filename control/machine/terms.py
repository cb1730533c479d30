"""What does a machine do beyond the catalogue? The module defines terms, as data in the machine
file; `step_term` evaluates them.

A term adds a value to one quantity of one stage (`acts_on`); the value is a form over one or two
recorded variables.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from enum import StrEnum
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError
from topdress.control.frozen_model import FrozenModel
from topdress.control.signals import SIGNALS

from .model_elements import Table
from .term_form import FORMS, SHAFT_ANGLE, TermParams
from .term_forms import MAX_TABLE_NODES, Form, make_params


class TermTarget(StrEnum):
    """Names the quantity of a stage that a term changes, with its unit."""

    # Change of the shaft speed, % of the command.
    SHAFT_PERCENT = "shaft_percent"
    # Change of the shaft speed while the shaft is commanded to turn, r/min.
    SHAFT_RPM = "shaft_rpm"
    # Change of the true opening, mm.
    GATE_MM = "gate_mm"
    FLOW_PERCENT = "flow_percent"
    # Change of the flow while the shaft turns, kg/min.
    FLOW_KG_MIN = "flow_kg_min"
    # Change of the scale's reading, kg.
    SCALE_KG = "scale_kg"
    # Drift of the scale's reading, kg/min.
    SCALE_KG_MIN = "scale_kg_min"
    # Change of the wheel's speed reading, %.
    WHEEL_PERCENT = "wheel_percent"


TARGET_STAGES = {
    TermTarget.SHAFT_PERCENT: "shaft",
    TermTarget.SHAFT_RPM: "shaft",
    TermTarget.GATE_MM: "gate",
    TermTarget.FLOW_PERCENT: "flow",
    TermTarget.FLOW_KG_MIN: "flow",
    TermTarget.SCALE_KG: "scale",
    TermTarget.SCALE_KG_MIN: "scale",
    TermTarget.WHEEL_PERCENT: "speed",
}
TARGET_UNITS = {
    TermTarget.SHAFT_PERCENT: "%",
    TermTarget.SHAFT_RPM: "r/min",
    TermTarget.GATE_MM: "mm",
    TermTarget.FLOW_PERCENT: "%",
    TermTarget.FLOW_KG_MIN: "kg/min",
    TermTarget.SCALE_KG: "kg",
    TermTarget.SCALE_KG_MIN: "kg/min",
    TermTarget.WHEEL_PERCENT: "%",
}
# Recorded variables with their units. For its own stage a term uses the command that the drive
# follows at that time; the shaft's angle counts from the start of the run.
VARIABLES = {
    **{name: one.unit for name, one in SIGNALS.items() if one.term_label},
    SHAFT_ANGLE: "deg",
}


Number = Annotated[float, Field(ge=-1e9, le=1e9)]


class Variable(FrozenModel):
    """Holds a variable that a term depends on. valid: observed range of the variable; beyond it
    the term keeps its edge value."""

    name: Annotated[str, Field(min_length=1, max_length=200)]
    # Unit of a column that is not in the run log's format.
    unit: str = ""
    valid: tuple[Number, Number] | None = None

    @model_validator(mode="after")
    def _check_unit(self) -> Variable:
        if self.valid is not None and not self.valid[0] < self.valid[1]:
            raise PydanticCustomError(
                "size_of_effect",
                "allowed a lower end below the upper one",
                {"wrong_key": ("valid",)},
            )
        if self.name in VARIABLES and self.unit not in ("", VARIABLES[self.name]):
            raise PydanticCustomError(
                "size_of_effect",
                "{allowed}",
                {
                    "wrong_key": ("unit",),
                    "allowed": f"allowed {VARIABLES[self.name]} for {self.name}",
                },
            )
        return self

    @property
    def displayed_unit(self) -> str:
        return VARIABLES.get(self.name, self.unit)


class Source(FrozenModel):
    """Holds the origin of a term."""

    data: str = ""
    sha256: str = ""
    date: str = ""
    note: str = ""


class Interval(NamedTuple):
    """Holds the 90 % interval of a coefficient."""

    name: str
    low: Number
    high: Number


class Term(FrozenModel):
    """Holds one term of the machine file."""

    id: Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[a-z][a-z0-9_.]*$")]
    title: str = ""
    acts_on: TermTarget
    form: Form
    over: Annotated[tuple[Variable, ...], Field(min_length=1, max_length=2)]
    coefficients: dict[str, Number] = {}
    intervals: Annotated[tuple[Interval, ...], Field(max_length=100)] = ()
    nodes: Annotated[tuple[Number, ...], Field(max_length=100)] = ()
    values: Annotated[tuple[Number, ...], Field(max_length=100)] = ()
    # Share of the held-out error that the term explains.
    held_out_gain: Number | None = None
    source: Source = Source()

    def __hash__(self) -> int:
        return hash(
            (
                self.id,
                self.acts_on,
                self.form,
                self.over,
                tuple(self.coefficients.items()),
                self.nodes,
                self.values,
            )
        )

    @model_validator(mode="after")
    def _check_consistency(self) -> Term:
        self._check_numbers()
        self._check_ends()
        self._check_variables()
        self._check_table()
        return self

    def _check_numbers(self) -> None:
        use = FORMS[self.form]
        allowed = (*use.needs, *use.may)
        for name in self.coefficients:
            if name not in allowed:
                _raise_wrong_key(
                    ("coefficients", name),
                    f"allowed: form {self.form.value} has {_join_names(allowed)}",
                )
        for name in use.needs:
            if name not in self.coefficients:
                _raise_wrong_key(
                    ("coefficients",),
                    f"{name} is missing: form {self.form.value} needs {_join_names(use.needs)}",
                )
        for name in use.positive:
            if not self.coefficients.get(name, 1.0) > 0.0:
                _raise_wrong_key(("coefficients", name), "allowed more than 0")

    def _check_variables(self) -> None:
        form, names = FORMS[self.form], self.variable_names
        if len(names) != form.variables:
            many = "s" if form.variables > 1 else ""
            _raise_wrong_key(
                ("over",), f"allowed: form {self.form.value} has {form.variables} variable{many}"
            )
        if form.only_over and names[0] not in form.only_over:
            _raise_wrong_key(
                ("over", 0, "name"),
                f"allowed: form {self.form.value} is over {_join_names(form.only_over)}",
            )
        if SHAFT_ANGLE in names and SHAFT_ANGLE not in form.only_over:
            _raise_wrong_key(
                ("over", 0, "name"), f"allowed: {SHAFT_ANGLE} has form {Form.PERIODIC.value}"
            )

    def _check_ends(self) -> None:
        low, high = self.coefficients.get("low_end"), self.coefficients.get("high_end")
        if low is not None and high is not None and not low < high:
            _raise_wrong_key(
                ("coefficients", "high_end"), f"allowed more than low_end, which is {low:g}"
            )

    def _check_table(self) -> None:
        if self.form is not Form.TABLE:
            for name in ("nodes", "values"):
                if getattr(self, name):
                    _raise_wrong_key((name,), "allowed: only form table has nodes and values")
            return
        if not 2 <= len(self.nodes) <= MAX_TABLE_NODES:
            _raise_wrong_key(("nodes",), f"allowed 2 to {MAX_TABLE_NODES} rising numbers")
        if any(b <= a for a, b in zip(self.nodes, self.nodes[1:], strict=False)):
            _raise_wrong_key(("nodes",), "allowed rising numbers")
        if len(self.values) != len(self.nodes):
            _raise_wrong_key(("values",), f"allowed as many as nodes, {len(self.nodes)}")

    @property
    def stage(self) -> str:
        return TARGET_STAGES[self.acts_on]

    @property
    def unit(self) -> str:
        """Returns the unit of its value."""
        return TARGET_UNITS[self.acts_on]

    @property
    def variable_names(self) -> tuple[str, ...]:
        return tuple(one.name for one in self.over)


def _raise_wrong_key(key: tuple[str | int, ...], allowed: str) -> None:
    raise PydanticCustomError("size_of_effect", "{allowed}", {"wrong_key": key, "allowed": allowed})


def _join_names(names: Iterable[str]) -> str:
    return ", ".join(names)


@lru_cache(maxsize=256)
def make_term_params(term: Term) -> TermParams:
    """Returns a term as numbers for its evaluator."""
    low, high = term.over[0].valid or (-1e300, 1e300)
    second_low, second_high = (
        (term.over[1].valid or (-1e300, 1e300)) if len(term.over) > 1 else (-1e300, 1e300)
    )
    numbers: dict[str, Any] = {name: float(value) for name, value in term.coefficients.items()}
    if term.nodes:
        numbers |= {"nodes": _fill_table(term.nodes, 1.0), "values": _fill_table(term.values, 0.0)}
    return make_params(
        term.form,
        low=float(low),
        high=float(high),
        second_low=float(second_low),
        second_high=float(second_high),
        **numbers,
    )


def _fill_table(numbers: tuple[float, ...], step: float) -> Table:
    """Returns eight numbers: beyond the last node the table is constant."""
    more = MAX_TABLE_NODES - len(numbers)
    a, b, c, d, e, f, g, h = (
        *map(float, numbers),
        *(float(numbers[-1] + step * (k + 1)) for k in range(more)),
    )
    return a, b, c, d, e, f, g, h


def name_own_command(stage: str, variable: str) -> str:
    """Returns the name of the value that a term of a stage uses: for its own drive, the command
    that the drive follows at that time."""
    commands = {("shaft", "shaft_rpm"): COMMANDED_RPM, ("gate", "opening_mm"): COMMANDED_MM}
    return commands.get((stage, variable), variable)


def list_needed_values(term: Term) -> tuple[str, ...]:
    """Returns the names of the values that a term uses."""
    return tuple(name_own_command(term.stage, name) for name in term.variable_names)


COMMANDED_RPM, COMMANDED_MM = "told_rpm", "told_mm"

# The following code reads old machine files.

_OLD_TABLES = {
    "shaft": ("table_percent", TermTarget.SHAFT_PERCENT),
    "gate": ("table_mm", TermTarget.GATE_MM),
    "flow": ("table_percent", TermTarget.FLOW_PERCENT),
    "scale": ("table_kg", TermTarget.SCALE_KG),
    "speed": ("table_percent", TermTarget.WHEEL_PERCENT),
    "heads": ("table_percent", None),
    "fall": ("table_s", None),
}
OLD_TABLE_NOTE = "was a table in an older machine file (tables_over)"


def convert_old_tables(data: dict[str, Any]) -> dict[str, Any]:
    """Converts a machine file without terms: its tables become terms; tables without a variable
    are dropped."""
    over = data.get("tables_over")
    data = {key: value for key, value in data.items() if key != "tables_over"}
    named: dict[str, Any] = over if isinstance(over, dict) else {}
    found: list[Any] = []
    for stage, (field, acts_on) in _OLD_TABLES.items():
        part = data.get(stage)
        if not isinstance(part, dict) or not {"table_x", field} & part.keys():
            continue
        nodes, values = part.get("table_x"), part.get(field)
        data[stage] = {key: value for key, value in part.items() if key not in ("table_x", field)}
        if (
            acts_on is not None
            and stage in named
            and nodes is not None
            and values is not None
            and any(values)
        ):
            found.append(
                {
                    "id": f"{stage}.table",
                    "acts_on": acts_on.value,
                    "form": Form.TABLE.value,
                    "over": [{"name": named[stage]}],
                    "nodes": list(nodes),
                    "values": list(values),
                    "source": {"note": OLD_TABLE_NOTE},
                }
            )
    return {**data, "terms": [*(data.get("terms") or ()), *found]} if found else data


# The following code parses terms written by hand.

_COEFFICIENT_PATTERN = re.compile(r"(?P<key>[a-z_]+)=(?P<value>\S+)")
TERM_GRAMMAR = "ACTS_ON FORM VARIABLE[,VARIABLE] COEFFICIENT=NUMBER ... [valid=LOW:HIGH[,LOW:HIGH]]"
TERM_EXAMPLE = "flow_percent bend speed_mps bend=-4.4 at=1.2 valid=0.6:2.3"


def parse_term(text: str, explained: Callable[[dict[str, Any]], Term]) -> Term:
    """Parses the value of a `--term` option. explained: makes the term from plain data.

    Raises
    ------
    ValueError : in one plain line.
    """
    words = text.split()
    items = [_COEFFICIENT_PATTERN.fullmatch(word) for word in words[3:]]
    if len(words) < 3 or any(item is None for item in items):
        raise ValueError(
            f"term {text!r}: not understood: allowed {TERM_GRAMMAR}, e.g. {TERM_EXAMPLE}"
        )
    given = {item["key"]: item["value"] for item in items if item is not None}
    valid, numbers = given.pop("valid", ""), {}
    try:
        tables = {
            key: [float(one) for one in given.pop(key).split(",")]
            for key in ("nodes", "values")
            if key in given
        }
        numbers = {key: float(value) for key, value in given.items()}
        ranges = (
            [[float(end) for end in part.split(":")] for part in valid.split(",")] if valid else []
        )
    except ValueError:
        raise ValueError(
            f"term {text!r}: coefficients and ranges are numbers, e.g. {TERM_EXAMPLE}"
        ) from None
    over: list[dict[str, Any]] = [{"name": name} for name in words[2].split(",")]
    if len(ranges) > len(over):
        raise ValueError(f"term {text!r}: valid: allowed one LOW:HIGH for each variable")
    for one, span in zip(over, ranges, strict=False):
        one["valid"] = span
    return explained(
        {
            "id": f"{words[0]}.{words[1]}",
            "acts_on": words[0],
            "form": words[1],
            "over": over,
            "coefficients": numbers,
            **tables,
        }
    )
