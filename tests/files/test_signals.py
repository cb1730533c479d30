"""A number of the machine is declared once (control/signals.py): every table of columns is made
of the declarations, and no module keeps a list of its own."""

from __future__ import annotations

import ast
import math
import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import pytest
from topdress.console.app.trend_channels import CHANNELS, RATE_ERROR_ID
from topdress.console.app.units import METRIC, Units
from topdress.control.log_row import (
    COLUMNS,
    NDRE_COLUMNS,
    TEXT_COLUMNS,
    VALID_FOR_S,
    WHOLE_COLUMNS,
    make_row_schema,
)
from topdress.control.readings import SENSED_COLUMNS, Measurements
from topdress.control.signals import SIGNALS, VALID_FOR, Signal
from topdress.control.simulation.plant import SensorReadings
from topdress.drivers.devices.registry import list_line_devices
from topdress.drivers.devices.slave_board import BOARD_READINGS
from topdress.drivers.files.foreign_logs import LOSSES

ROOT = Path(__file__).parents[2]
# Least number of columns in a literal that makes it a list of columns.
LEAST_NAMES = 4
# Literals with several columns that say something else than a declaration, and what.
NO_LISTS = {
    "console/services/fleet_job.py": {"_hash_measurements": "what makes a run the same"},
    "console/cli/import_log.py": {"_find_full_values": "full values of the drives"},
    "drivers/files/imports/physical_checks.py": {"find_speed_unit": "arguments by their columns"},
    "drivers/files/exports/as_applied.py": {"_select_worked_rows": "parts of a moved log"},
    "control/simulation/plant.py": {"_calc_terms": "the plant's own values"},
    "control/experiments/manoeuvres.py": {"_predict_log": "a predicted log"},
    "control/diagnosis/runs/cost.py": {"_list_operating_points": "nominal inputs of a point"},
    "control/calibration/bench_table.py": {"COLUMN_RANGES": "columns of bench tables"},
    "control/diagnosis/runs/log.py": {
        "_list_channel_targets": "which reading follows which column",
        "REQUIRED_COLUMNS": "what each stage needs",
        "DRIVE_EFFORT_COLUMNS": "what each stage needs",
        "NUMBER_COLUMNS": "what a diagnosis reads",
        "UNREAD_COLUMNS": "what `rates` reads",
    },
    "control/diagnosis/runs/smooth.py": {
        "MIN_RANGE": "least range for a dependence to show",
        "DOWNSTREAM_VARIABLES": "which variables a stage changes",
    },
    "control/diagnosis/runs/unit_change.py": {
        "UNITS": "units into which a column may change",
        "REFERENCES": "columns that go in proportion",
    },
    "control/safety/alarm_conditions.py": {"CONDITIONS": "details of alarms"},
    "control/simulation/closed_loop.py": {"RECORDED_COLUMNS": "what a simulated run records"},
    "drivers/devices/board_frames.py": {"STATUS_RANGES": "ranges of a status frame's fields"},
    "drivers/files/exports/export_columns.py": {"EXPORT_COLUMNS": "public columns of an export"},
    "drivers/files/file_content.py": {"_LOG_COLUMNS": "columns that no other kind of file has"},
    "drivers/files/imports/column_vocabulary.py": {"COLUMN_SUBJECTS": "needs several words"},
    "drivers/files/imports/guess_result.py": {"COMMAND_PAIRS": "which command is of which reading"},
    "drivers/files/imports/time_logs.py": {"_HEAD_FIELDS": "fields of an ISO 11783-10 time log"},
    "drivers/files/replay.py": {"_GNSS_COLUMNS": "fields of a fix, in its order"},
    "console/app/widgets/value_tiles.py": {"GRAPH_CHANNELS": "channels of the four tiles"},
    "console/cli/simulate.py": {
        "_format_truth": "columns of a simulation's truth",
        "TRUTH_COLUMNS": "columns of a simulation's truth",
    },
    "console/reports/variable_names.py": {
        "RUN_VARIABLES": "variables that are no column, or another one than that of their name",
        "TABLE_VARIABLES": "columns of bench tables",
    },
}


def name_columns(node: ast.AST) -> set[str]:
    """Returns the columns that an expression names."""
    return {
        one.value
        for one in ast.walk(node)
        if isinstance(one, ast.Constant) and isinstance(one.value, str) and one.value in SIGNALS
    }


def iter_lists(text: str) -> Iterator[tuple[str, set[str]]]:
    """Yields each constant of a module or class, and each function with a list, set or mapping,
    that names several columns."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            for one in ast.walk(node):
                if isinstance(one, ast.List | ast.Tuple | ast.Set | ast.Dict):
                    names = name_columns(one)
                    if len(names) >= LEAST_NAMES:
                        yield node.name, names
        if not isinstance(node, ast.Module | ast.ClassDef):
            continue
        for line in node.body:
            if not isinstance(line, ast.Assign | ast.AnnAssign) or line.value is None:
                continue
            target = line.targets[0] if isinstance(line, ast.Assign) else line.target
            names = name_columns(line.value)
            if len(names) >= LEAST_NAMES:
                yield ast.unparse(target), names


def list_measured_fields() -> set[str]:
    """Returns the measurements of the devices' own examples."""
    return {
        field
        for device in list_line_devices()
        for message in device.make_decoder(None).feed(device.make_example(), 0.0)
        for field in device.find_measurements(message)
    }


def find_lists(root: Path) -> dict[str, set[str]]:
    """Returns the constants with several columns, by file."""
    found: dict[str, set[str]] = {}
    for room in ("control", "drivers", "console"):
        for path in sorted((root / room).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            # Most modules name too few to be looked at.
            if len(SIGNALS.keys() & set(re.findall(r"""["'](\w+)["']""", text))) < LEAST_NAMES:
                continue
            for name, _ in iter_lists(text):
                found.setdefault(path.relative_to(root).as_posix(), set()).add(name)
    return found


def test_no_module_keeps_a_list_of_columns() -> None:
    assert find_lists(ROOT) == {file: set(names) for file, names in NO_LISTS.items()}, (
        "make it of the declarations in control/signals.py, or say in NO_LISTS what it says"
    )


def test_a_list_of_columns_is_seen() -> None:
    made = 'def f():\n    return ["shaft_rpm", "opening_mm", "supply_v", "ndvi"]\n'
    assert [name for name, _ in iter_lists(made)] == ["f"]
    made = 'class A:\n    TABLE = {"shaft_rpm": 1, "opening_mm": 2, "supply_v": 3, "ndvi": 4}\n'
    assert [name for name, _ in iter_lists(made)] == ["TABLE"]


def test_page_says_what_is_declared() -> None:
    page = ROOT / "docs" / "format-run-log.md"
    text = page.read_text(encoding="utf-8")
    write_tables = runpy.run_path(str(ROOT / ".ci" / "columns.py"))["write_tables"]
    assert write_tables(text) == text, "write it again: python .ci/columns.py"


@pytest.mark.parametrize("name", SIGNALS)
def test_declaration_is_complete(name: str) -> None:
    one = SIGNALS[name]
    assert one.meaning, "docs/format-run-log.md needs its meaning"
    if name in TEXT_COLUMNS:
        assert one == Signal(meaning=one.meaning, losses=one.losses, other_names=one.other_names), (
            "a text has no number's fields"
        )
    else:
        assert one.exact + (name in WHOLE_COLUMNS) + (one.decimals is not None) == 1, (
            "a number is exact, whole, or has decimals"
        )
        assert one.plausible or name in ("time_s", "work_switch")
    assert one.label or not one.is_on_run
    assert make_row_schema()["properties"][name]["description"] == one.meaning
    assert set(one.losses) <= set(LOSSES)
    assert not one.shown_as or one.shown_as in Units._fields


@pytest.mark.parametrize("name", VALID_FOR_S)
def test_times_that_differ_have_a_reason(name: str) -> None:
    *times, reason = VALID_FOR[name]
    assert bool(reason) == (len({s for s in times if math.isfinite(s)}) > 1)


@pytest.mark.parametrize("name", [name for name, one in SIGNALS.items() if one.possible])
def test_number_of_a_sensor_is_measured_simulated_and_logged(name: str) -> None:
    """What has a possible range is read by a sensor."""
    if name.startswith(("ndvi_", "ndre_")):
        return
    assert name in SENSED_COLUMNS, f"no field {name} of control.readings.Measurements"
    assert name in VALID_FOR_S, "a reading grows old: valid_for"
    assert name in {*BOARD_READINGS, *list_measured_fields()}, "no device reads it"
    virtual = name in SensorReadings._fields or name not in BOARD_READINGS
    assert virtual, f"no field {name} of SensorReadings (plant.py)"


def test_row_of_a_tick_has_every_number() -> None:
    """What no sensor reads is computed."""
    tree = ast.parse((ROOT / "control" / "loop" / "tick_row.py").read_text(encoding="utf-8"))
    (row,) = (
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "LogRow"
    )
    computed = {keyword.arg for keyword in row.keywords} - {None}
    assert computed == set(SIGNALS) - set(SENSED_COLUMNS)


def test_trends_plot_every_number() -> None:
    numbers = {*COLUMNS} - {"time_s", *NDRE_COLUMNS, *TEXT_COLUMNS}
    assert {channel.id for channel in CHANNELS} == numbers | {RATE_ERROR_ID}
    supply = next(channel for channel in CHANNELS if channel.id == "supply_v")
    assert (supply.label, *supply.unit(METRIC)) == ("supply", "V", 1.0, 2)


def test_measurements_have_no_undeclared_reading() -> None:
    readings = {
        name for name, kind in Measurements.__annotations__.items() if "Reading | None" in str(kind)
    } - {"ndvi"}
    assert readings == {*SENSED_COLUMNS, "rate_asked", "rate_applied"}


def test_inputs_of_stages_are_smoothed_as_declared() -> None:
    """No stage of the diagnosis smooths an input by a time of its own."""
    runs = ROOT / "control" / "diagnosis" / "runs"
    callers = {
        path.stem
        for path in runs.glob("*.py")
        if "smooth_series(" in path.read_text(encoding="utf-8")
    }
    # The drives only look for a shaft that stands.
    assert callers == {"grid", "drives"}
    assert {name for name, one in SIGNALS.items() if one.smoothed_s is not None} == {
        "hopper_kg",
        "pitch_deg",
        "roll_deg",
        "speed_mps",
        "supply_v",
    }
