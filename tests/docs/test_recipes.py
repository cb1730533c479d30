"""docs/recipes.md says what works: each recipe is followed in a copy of the tree, the checks that
it names pass there, and the console starts and shows the change. Without a step the same checks
fail."""

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
    "topdress effects --markdown docs/effects.md": (
        sys.executable,
        "-c",
        "from topdress.console.cli import app; app()",
        "effects",
        "--markdown",
        "docs/effects.md",
    ),
    "python .ci/columns.py": (sys.executable, ".ci/columns.py"),
    "python .ci/folders.py": (sys.executable, ".ci/folders.py"),
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


class Copy(NamedTuple):
    """A folder that is copied, and the texts that are replaced in its files."""

    file: str
    source: str
    texts: tuple[tuple[str, str], ...]


# A step is a number of insertions, a copy of a folder, or a command.
Step = tuple[Insertion, ...] | Copy | str


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
from topdress.console.app.trend_channels import BY_ID, find_value
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
                "\n\nclass PlantTruth(NamedTuple):",
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
        (Insertion("console/locale/zh/devices.po", "", translate("fuel rate", "油耗")),),
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
                "control/loop/tick_row.py",
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
EFFECT = Recipe(
    "An effect of the diagnosis",
    (
        (
            Insertion(
                "control/machine/shaft.py",
                "    encoder_step_rpm: Annotated[",
                """    slope_percent_per_deg: Annotated[
        float,
        Field(ge=-5, le=5),
        Effect(
            "shaft.slope",
            "% more per degree nose up",
            "Shaft turns faster or slower on a slope",
            "On a slope the material weighs on the rollers more or less.",
            "drives without an encoder: 0.5-2 % per degree",
            ("run",),
            "Let the drive hold its speed by an encoder.",
            "Out and back on a slope at one shaft command.",
            says=(
                "Each degree uphill adds {size} % to the shaft's speed.",
                "Each degree uphill takes {size} % off the shaft's speed.",
            ),
        ),
    ] = 0.0
""",
            ),
            Insertion(
                "control/machine/shaft.py",
                "    return abs(1.0 + p.gain_percent / 100.0) * (1.0 - sag",
                "    droop -= p.slope_percent_per_deg * u.pitch_deg\n",
            ),
        ),
        (
            Insertion(
                "control/diagnosis/effects.py",
                "SHAFT_COARSE_ENCODER = ",
                'SHAFT_SLOPE = EffectRow("shaft.slope", 1.0, (0.2,), form_over="pitch_deg")\n',
            ),
            Insertion(
                "control/diagnosis/effects.py",
                "        SHAFT_COARSE_ENCODER,\n",
                "        SHAFT_SLOPE,\n",
            ),
        ),
        (
            Insertion(
                "console/locale/zh/diagnosis.po",
                "",
                translate("Shaft turns faster or slower on a slope", "排肥轴随坡度变快或变慢")
                + translate(
                    "Each degree uphill adds {size} % to the shaft's speed.",
                    "每上坡一度，轴速增加 {size} %。",
                )
                + translate(
                    "Each degree uphill takes {size} % off the shaft's speed.",
                    "每上坡一度，轴速减少 {size} %。",
                )
                + translate("Let the drive hold its speed by an encoder.", "用编码器稳定轴速。")
                + translate(
                    "Out and back on a slope at one shaft command.",
                    "在坡上以同一轴速指令往返行驶。",
                ),
            ),
        ),
        (
            Insertion(
                "tests/machine/test_catalogue.py",
                '    "shaft.stall": (',
                '    "shaft.slope": (-5, 5, "% more per degree nose up"),\n',
            ),
        ),
        (
            Insertion(
                "tests/diagnosis/hidden/nominal.py",
                '    "shaft.stall": Kind(',
                '    "shaft.slope": Kind(0, 0.2, 5.0, "%/deg", (), is_new=True),\n',
            ),
        ),
        (
            Insertion(
                "tests/diagnosis/hidden/plant.py",
                '            elif e.id == "shaft.stall":',
                '            elif e.id == "shaft.slope":\n'
                '                hill = shapes.tilted(self.fine("pitch_deg"), e.form, e.knob)\n'
                "                factor = factor * (1 + size / 100 * hill)\n",
            ),
        ),
        "topdress effects --markdown docs/effects.md",
        "topdress check --write-schemas schemas",
    ),
    """
from topdress.console.cli import app

app(["simulate", "--seconds", "3", "--effect", "shaft.slope=1", "--out", "made.csv"],
    standalone_mode=False)
""",
)
CLOCK_PAGE = '''"""Shows the Clock screen: the time of the machine."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.widgets import Static
from topdress.console.app.action import CLOCK, make_bindings
from topdress.console.app.pages.base_page import Page
from topdress.console.app.pages.clock.keys import ACTIONS
from topdress.console.app.panel_views import RunView
from topdress.console.locale import _


class ClockScreen(Page):
    """Shows the time."""

    where: ClassVar[str] = CLOCK
    BINDINGS: ClassVar = make_bindings(ACTIONS)
    decimals = 0

    def compose_body(self) -> ComposeResult:
        yield Static(id="clock")

    def show_numbers(self, view: RunView) -> None:
        """Show the time of the newest frame."""
        super().show_numbers(view)
        frame, _age_s = self.find_frame(self.app.clock())
        time_s = 0.0 if frame is None else frame.row.time_s
        self.query_one("#clock", Static).update(f"{_('time')} {time_s:.{self.decimals}f} s")

    def toggle_tenths(self) -> None:
        """Show tenths of a second, or hide them."""
        self.decimals = 1 - self.decimals
'''
CLOCK_KEYS = '''"""Defines the keys of the Clock page."""

from __future__ import annotations

from topdress.console.app.action import CLOCK, Action, set_page
from topdress.console.locale import N_

ACTIONS = set_page(
    CLOCK,
    Action(
        "clock_tenths",
        "q_1",
        "",
        N_("tenths"),
        N_("Shows tenths of a second, or hides them."),
        lambda page: page.toggle_tenths(),
    ),
)
'''
NEW_PAGE = Recipe(
    "A page",
    (
        (
            Insertion(
                "console/app/action.py",
                "\n\nclass Action(NamedTuple):",
                'CLOCK = "clock"\n',
            ),
        ),
        (Insertion("console/app/pages/clock/page.py", "", CLOCK_PAGE),),
        (Insertion("console/app/pages/clock/keys.py", "", CLOCK_KEYS),),
        (
            Insertion(
                "console/app/pages/clock/__init__.py",
                "",
                '"""The Clock page shows the time of the machine.\n"""\n',
            ),
        ),
        (
            Insertion(
                "console/app/actions.py",
                "from topdress.console.app.pages.devices import",
                "from topdress.console.app.pages.clock import keys as clock\n",
            ),
            Insertion("console/app/actions.py", "    *common.ACTIONS,\n", "    *clock.ACTIONS,\n"),
        ),
        (
            Insertion(
                "console/app/pages/page_registry.py",
                "    DEVICES,\n    DIAGNOSIS,",
                "    CLOCK,\n",
            ),
            Insertion(
                "console/app/pages/page_registry.py",
                '    SETTINGS: "SettingsScreen",',
                '    CLOCK: "ClockScreen",\n',
            ),
        ),
        (
            Insertion("console/app/common_keys.py", "    DEVICES,\n    DIAGNOSIS,", "    CLOCK,\n"),
            Insertion(
                "console/app/common_keys.py",
                '    Action(\n        "settings_screen",',
                """    Action(
        "clock_screen",
        "ctrl+g",
        "^G",
        N_("clock"),
        N_("The time of the machine."),
        lambda app: app.turn_to_page(CLOCK),
        locked=True,
    ),
""",
            ),
        ),
        (
            Insertion("console/app/tablet_app.py", "    DIAGNOSIS,\n    MAP,", "    CLOCK,\n"),
            Insertion("console/app/tablet_app.py", "MAP, TRENDS, REPLAY})", "CLOCK, "),
        ),
        (
            Insertion(
                "console/locale/zh/clock.po",
                "",
                'msgid ""\nmsgstr ""\n"Language: zh\\n"\n'
                '"Content-Type: text/plain; charset=UTF-8\\n"\n'
                + translate("clock", "时钟")
                + translate("The time of the machine.", "机器时间。")
                + translate("tenths", "十分之一")
                + translate("Shows tenths of a second, or hides them.", "显示或隐藏十分之一秒。"),
            ),
        ),
        (Insertion("tests/app/gallery.py", "    alarm-list-100x30!", "    clock-120x40-day\n"),),
        (
            Insertion(
                "docs/screens/README.md",
                "| Settings | `F11` |",
                "| Clock | `^G` | the time of the machine |\n",
            ),
        ),
        "python .ci/folders.py",
    ),
    """
import asyncio
from tests.app.gallery import Picture, draw

picture = asyncio.run(draw(Picture("clock", (120, 40), screen="clock")))
assert "time" in picture and "clock" in picture
""",
)
LANGUAGE = Recipe(
    "A language",
    (
        Copy(
            "console/locale/de/*.po",
            "console/locale/zh",
            (("Language: zh", "Language: de"), ("暂停", "halten")),
        ),
        (Insertion("drivers/files/settings.py", '"zh"] = "auto"', '"de", '),),
        (Insertion("console/app/pages/settings/page.py", '"zh": "中文"}', '"de": "Deutsch", '),),
        "topdress check --write-schemas schemas",
    ),
    """
import asyncio
from tests.app.gallery import Picture, draw

assert "halten" in asyncio.run(draw(Picture("de", (120, 40), language="de", screen="run")))
""",
)
RECIPES = (SENSED, COMPUTED, ALARM, EFFECT, NEW_PAGE, LANGUAGE)


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
    if isinstance(step, Copy):
        made = Path(shutil.copytree(tree / step.source, (tree / step.file).parent))
        for path in made.iterdir():
            text = path.read_text(encoding="utf-8")
            for old, new in step.texts:
                text = text.replace(old, new)
            path.write_text(text, encoding="utf-8")
        return
    for file, before, text in step:
        path = tree / file
        path.parent.mkdir(exist_ok=True)
        old = path.read_text(encoding="utf-8") if path.exists() else ""
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
        named = (
            {step}
            if isinstance(step, str)
            else {step.file}
            if isinstance(step, Copy)
            else {one.file for one in step}
        )
        first = re.match(r"`([^`]+)`", text)
        assert first is not None
        path = first[1]
        for word, example in {"STAGE": "shaft", "NAME": "clock", "CODE": "de"}.items():
            path = path.replace(word, example)
        assert named == {path}
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
    # one step of each recipe, each in another place: a case takes a dozen seconds
    [(recipe, (2 * n + 1) % len(recipe.steps)) for n, recipe in enumerate(RECIPES)],
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
