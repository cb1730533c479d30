"""docs/recipes.md says what works: each recipe is followed in a copy of the tree, the checks that
it names pass there, and the console starts and shows the change. Without any of its steps the same
checks fail."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
ROOMS = ("topdress", "control", "drivers", "console", "configs", "schemas", "docs", "tests", ".ci")
COMMANDS = {
    "python .ci/columns.py": (sys.executable, ".ci/columns.py"),
    "topdress check --write-schemas schemas": (
        sys.executable,
        "-c",
        "from topdress.console.cli import app; app()",
        "check",
        "--write-schemas",
        "schemas",
    ),
}


class Insertion(NamedTuple):
    """A text that stands before another one of a file; "": at its end."""

    file: str
    before: str
    text: str


# A step is a number of insertions, or a command.
Step = tuple[Insertion, ...] | str


class Recipe(NamedTuple):
    """A recipe of the page, the steps that it tells, and what the console does then."""

    title: str
    steps: tuple[Step, ...]
    shown: str


def translate(text: str, chinese: str) -> str:
    return f'\nmsgid "{text}"\nmsgstr "{chinese}"\n'


DECLARED = """    {name}: Annotated[
        OptionalFloat,
        Signal(
            "{unit}",
            2,
            plausible=(0.0, 200.0),
            {more}
            label=N_("{label}"),
            is_on_run=True,
            meaning="{label}",
        ),
    ] = None
"""
BEFORE_SECTIONS = "    # This column stands only in logs of machines whose sections have valves.\n"
SHOWN = """
import asyncio, subprocess, sys
from dataclasses import replace
from tests.app.gallery import Picture, draw
from tests.app.made_up.run import run_frames
from topdress.console.app.channels import BY_ID, find_value
from topdress.console.app.panel_views import make_run_view
from topdress.console.app.units import METRIC

for page in ("run", "trends"):
    assert "</svg>" in asyncio.run(draw(Picture(page, (120, 40), screen=page)))
name, label, value = {name!r}, {label!r}, {value}
frame = run_frames(seconds=1.0)[-1]
frame = replace(frame, row=frame.row._replace(**{{name: value}}))
assert (BY_ID[name].label, find_value(frame.row, name)) == (label, value)
assert label in [item.label for item in make_run_view(frame, 0.0, METRIC).items]
"""
# What the simulator reads is in its log, and what a log has is replayed.
LOGGED = """
from topdress.control.readings import Measurements, Reading
from topdress.drivers.files.read_log import read_log
from topdress.drivers.files.replay import iter_measurements
from topdress.console.cli import app

app(["simulate", "--seconds", "3", "--seed", "1", "--out", "made.csv"], standalone_mode=False)
log = read_log("made.csv")
assert set(log.numbers({name!r}).tolist()) == {{{value}}}, "the log lacks what the sensor reads"
assert getattr(list(iter_measurements(log))[-1], {name!r}).value == {value}
"""

SENSED = Recipe(
    "A number that a sensor reads",
    (
        (
            Insertion(
                "control/signals.py",
                BEFORE_SECTIONS,
                DECLARED.format(
                    name="fuel_l_h",
                    unit="L/h",
                    label="fuel rate",
                    more="possible=(-1_000.0, 1_000.0),\n            valid_for=ValidFor(2.0),",
                ),
            ),
        ),
        (
            Insertion(
                "control/readings.py",
                "    # Rate that another display wants.\n",
                "    fuel_l_h: Reading | None = None\n",
            ),
        ),
        (
            Insertion(
                "control/simulation/plant.py",
                "\n\nclass Truth(NamedTuple):",
                "    fuel_l_h: float | None = 12.5\n",
            ),
        ),
        (
            Insertion(
                "drivers/devices/slave_board.py",
                "\n\nclass SlaveBoard(",
                "    fuel_l_h: Reading | None = None\n",
            ),
        ),
        (Insertion("console/locale/zh/trends.po", "", translate("fuel rate", "油耗")),),
        "python .ci/columns.py",
    ),
    SHOWN.format(name="fuel_l_h", label="fuel rate", value=12.5)
    + LOGGED.format(name="fuel_l_h", value=12.5),
)
COMPUTED = Recipe(
    "A number that control computes",
    (
        (
            Insertion(
                "control/signals.py",
                BEFORE_SECTIONS,
                DECLARED.format(
                    name="flow_kg_min", unit="kg/min", label="outflow", more="group='flow',"
                ),
            ),
        ),
        (
            Insertion(
                "control/loop/row.py",
                "        flow_trim=metered.trim,\n",
                "        flow_kg_min=60.0 * metered.trim,\n",
            ),
        ),
        (Insertion("console/locale/zh/trends.po", "", translate("outflow", "排肥流量")),),
        "python .ci/columns.py",
    ),
    SHOWN.format(name="flow_kg_min", label="outflow", value=5.5),
)
ALARM = Recipe(
    "An alarm",
    (
        (
            Insertion(
                "control/safety/alarms.py",
                '    AlarmKind(\n        "refill_disagrees",',
                '    AlarmKind(\n        "hopper_over",\n        _AMBER,\n'
                '        N_("Hopper holds {hopper_kg} kg: more than its frame carries."),\n'
                '        N_("Take some out before you drive."),\n        N_("hopper"),\n    ),\n',
            ),
        ),
        (
            Insertion(
                "control/safety/limits.py",
                "    hopper_low_kg: float",
                "    # Load of the nominal frame, kg.\n    hopper_over_kg: float = 350.0\n",
            ),
        ),
        (
            Insertion(
                "control/machine/machine.py",
                "    gate_off_mm: Annotated",
                "    hopper_over_kg: Annotated[float, Field(ge=0, le=20000)] | None = None\n",
            ),
        ),
        (
            Insertion(
                "control/safety/alarm_conditions.py",
                '                "refill_disagrees": ',
                '                "hopper_over": lambda f: (\n'
                '                    (("hopper_kg", _round_known(f.seen.hopper_kg)),)\n'
                "                    if (f.seen.hopper_kg or 0.0) > f.limits.hopper_over_kg\n"
                "                    else None\n                ),\n",
            ),
        ),
        (
            Insertion(
                "tests/safety/test_safety_alarms.py",
                '    ("hopper_empty", {"hopper_kg": 0.3}',
                '    ("hopper_over", {"hopper_kg": 360.0}, 0.0, 0.05, State.WORKING),\n',
            ),
        ),
        (
            Insertion(
                "tests/safety/test_safety_limits.py",
                '    ("hopper_low_kg", 50.0,',
                '    ("hopper_over_kg", 500.0, alarms(hopper_kg=400.0)),\n',
            ),
            Insertion(
                "tests/safety/test_safety_limits.py",
                '    "hopper_low_kg",\n',
                '    "hopper_over_kg",\n',
            ),
        ),
        (
            Insertion(
                "docs/safety.md",
                "| hopper at 30 kg or less",
                "| hopper above 350 kg | hopper_over (amber) | |\n",
            ),
        ),
        (
            Insertion(
                "console/locale/zh/core.po",
                "",
                translate(
                    "Hopper holds {hopper_kg} kg: more than its frame carries.",
                    "料箱载有 {hopper_kg} kg：超过机架承载。",
                )
                + translate("Take some out before you drive.", "行驶前请取出一些。"),
            ),
        ),
        "topdress check --write-schemas schemas",
    ),
    """
import asyncio
from tests.app.gallery import Picture, draw
from topdress.control.machine.machine import Limits
from topdress.control.safety import SafetyLimits, select_machine_limits

assert "</svg>" in asyncio.run(draw(Picture("run", (120, 40), alarms=True)))
assert SafetyLimits(**select_machine_limits(Limits(hopper_over_kg=3000.0))).hopper_over_kg == 3000.0
""",
)
RECIPES = (SENSED, COMPUTED, ALARM)


def read_section(title: str) -> str:
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def read_steps(title: str) -> list[str]:
    """Returns the numbered steps of a recipe on the page."""
    found = re.split(r"^\d+\. ", read_section(title), flags=re.MULTILINE)[1:]
    return [text.partition("\n\n")[0] for text in found]


def read_checks(title: str) -> list[str]:
    """Returns the tests that the page names first behind the steps."""
    commands = re.findall(r"`python -m pytest ([^`]+)`", read_section(title))
    return re.findall(r"tests/[\w/]+\.py", commands[0])


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree, to be copied again."""
    made = tmp_path_factory.mktemp("tree")
    for room in ROOMS:
        shutil.copytree(ROOT / room, made / room)
    for file in ("pyproject.toml", "CONTRIBUTING.md", "README.md", "CHANGELOG.md"):
        shutil.copy2(ROOT / file, made / file)
    return made


def run(tree: Path, *command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree), "TOPDRESS_LANGUAGE": "en"},
        capture_output=True,
        text=True,
        timeout=280,
    )


def make_step(tree: Path, step: Step) -> None:
    if isinstance(step, str):
        # A command that stops says by itself that a step before it is missing.
        run(tree, *COMMANDS[step])
        return
    for file, before, text in step:
        path = tree / file
        old = path.read_text(encoding="utf-8")
        assert before == "" or old.count(before) == 1, f"{file}: {before!r}"
        path.write_text(old + text if before == "" else old.replace(before, text + before))


def check(tree: Path, recipe: Recipe) -> str:
    """Returns what fails: a test that the page names, or the console; "" if all is well."""
    tests = run(
        tree, sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider",
        *read_checks(recipe.title),
    )  # fmt: skip
    if tests.returncode:
        return tests.stdout[-3000:] + tests.stderr[-1000:]
    console = run(tree, sys.executable, "-c", recipe.shown)
    return console.stderr[-3000:] if console.returncode else ""


def copy_tree(tree: Path, to: Path) -> Path:
    return Path(shutil.copytree(tree, to / "tree"))


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda one: one.title)
def test_steps_are_those_of_the_page(recipe: Recipe) -> None:
    texts = read_steps(recipe.title)
    assert len(texts) == len(recipe.steps)
    for text, step in zip(texts, recipe.steps, strict=True):
        named = {step} if isinstance(step, str) else {one.file for one in step}
        first = re.match(r"`([^`]+)`", text)
        assert first is not None and named == {first[1]}
    assert read_checks(recipe.title)


@pytest.mark.exam
@pytest.mark.parametrize("recipe", RECIPES, ids=lambda one: one.title)
def test_recipe_works(recipe: Recipe, tree: Path, tmp_path: Path) -> None:
    made = copy_tree(tree, tmp_path)
    for step in recipe.steps:
        make_step(made, step)
    assert check(made, recipe) == ""


@pytest.mark.exam
@pytest.mark.parametrize(
    ("recipe", "left_out"),
    [(recipe, k) for recipe in RECIPES for k in range(len(recipe.steps))],
    ids=lambda one: one.title if isinstance(one, Recipe) else f"without {one + 1}",
)
def test_step_that_is_left_out_is_noticed(
    recipe: Recipe, left_out: int, tree: Path, tmp_path: Path
) -> None:
    made = copy_tree(tree, tmp_path)
    for k, step in enumerate(recipe.steps):
        if k != left_out:
            make_step(made, step)
    assert check(made, recipe) != "", f"step {left_out + 1} can be forgotten"
