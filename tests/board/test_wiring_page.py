"""docs/wiring.md and its schematic have the pins of the boards' main programs, and their
settings."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "wiring.md").read_text(encoding="utf-8")
SVG = "{http://www.w3.org/2000/svg}"
OUT = re.compile(r"enable|step|direction|^clock")
KINDS = [
    (re.compile(r"^UART .*115 200"), "uart .* 115200"),
    (re.compile(r"PWM 20 kHz"), "pwm 20000"),
    (re.compile(r"^I2C .*400 kHz"), "i2c .* 400000"),
    (re.compile(r"0 to 3\.3 V|kOhm"), "adc"),
]


def of_program(program: str) -> tuple[dict[str, str], set[str]]:
    """The pins that it takes, and the names of its settings."""
    said = subprocess.run(
        [sys.executable, "-m", "tests.board.pico", "--pins", program],
        capture_output=True,
        text=True,
        check=True,
    )
    pins, settings = json.loads(said.stdout)
    return {f"GP{number}": kind for number, kind in pins.items()}, set(settings)


def of_page(program: str) -> dict[str, tuple[str, str]]:
    """Pin -> its signal and the whole cell, as the page's table of this program has them."""
    section = PAGE.split(f"`{program}.py`\n")[1].split("\n## ")[0]
    found = {}
    for pins, signals in re.findall(r"^\| (GP[\d, GP]+) \| ([^|]+) \|", section, re.MULTILINE):
        names = pins.split(", ")
        for pin, signal in zip(names, signals.split(", "), strict=False):
            found[pin] = signal, signals
        assert len(signals.split(", ")) >= len(names)
    return found


@pytest.mark.parametrize("program", ["rp2_slave", "rp2_lag_rig"])
def test_the_table_has_the_programs_pins_and_what_each_does(program):
    pins, table = of_program(program)[0], of_page(program)
    assert set(table) == set(pins)
    for pin, (signal, cell) in table.items():
        kind = next(
            (kind for words, kind in KINDS if words.search(cell)),
            "out" if OUT.search(signal) else "in",
        )
        assert re.match(kind, pins[pin]), (pin, cell, pins[pin])


def test_each_net_of_the_schematic_is_a_pin_of_the_program_with_the_tables_signal():
    table = of_page("rp2_slave")
    nets = {
        group.get("id"): group
        for group in ElementTree.parse(DOCS / "wiring-slave-board.svg").iter(f"{SVG}g")
        if group.get("id")
    }
    assert set(nets) == set(table) | {"USB"}
    for pin, (signal, _) in table.items():
        texts = [text.text for text in nets[pin].iter(f"{SVG}text")]
        assert f"{signal} ".startswith(f"{texts[0]} "), (pin, texts)
        assert texts[-1] == pin and nets[pin].find(f"{SVG}path") is not None


def test_the_settings_of_the_page_are_the_boards():
    table = PAGE.split('<a id="settings">')[1].split("### Putting")[0]
    cells = " ".join(re.findall(r"^\| (`[^|]+) \|", table, re.MULTILINE))
    named = set(re.findall(r"`(\w+)`", cells))
    assert len(named) > 12 and named <= of_program("rp2_slave")[1]


def test_a_board_with_the_pages_first_settings_says_the_pages_first_line(plugged):
    settings = re.search(r"`board_settings.py`:\n\n((?:    .*\n)+)", PAGE)[1].replace("    ", "")
    shown = re.search(r"\$(S1,.*)\*CRC", PAGE)[1].split(",")
    pico = plugged(settings)
    said = subprocess.run(
        [
            sys.executable,
            "-c",
            "from topdress.console.cli import main; main()",
            "devices",
            pico.name,
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    found = re.search(r"slave-board/1 .* 0 rejected; last: \$(S1,.*)\*", said)[1].split(",")
    # seq, micros, pulses and their time: the made-up wheel turns
    for running in (1, 3, 4, 5):
        found[running] = shown[running]
    assert found == shown
