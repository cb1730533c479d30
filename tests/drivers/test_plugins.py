"""A package that adds a head, a receiver, a format and an effect by entry points, in a folder
of its own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLE = Path(__file__).parent / "example_plugin"
Ran = subprocess.CompletedProcess[str]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Ran]:
    """`topdress` where the example is installed, as an installer leaves it: the module, and its
    metadata."""
    folder = tmp_path_factory.mktemp("site")
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    shutil.copy(EXAMPLE / "topdress_example.py", folder)
    about = folder / "topdress_example-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    (about / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in points.items())
            for group, points in project["entry-points"].items()
        )
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(folder), str(ROOT)))}

    def run(*words: object, code: str = "from topdress.console.cli import main; main()") -> Ran:
        return subprocess.run(
            [sys.executable, "-P", "-c", code, *map(str, words)],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
        )

    return run


SAID = """import sys; from topdress.console.cli.terms import parse_terms
from topdress.console.reports.term_words import describe_term
print(describe_term(parse_terms(sys.argv[1:])[0].model_dump(mode="json")))"""


@pytest.mark.parametrize(
    ("protocol", "said", "value"),
    [
        ("two_fields", b"x,0.5\nx,0.6\n", {"ndvi_1": 0.6}),
        ("plain_fix", b"40.5 117.1\nno\n", {"lat_deg": 40.5}),
    ],
)
def test_a_device_is_decoded_and_allowed_in_a_cab_file(
    installed: Callable[..., Ran],
    tmp_path: Path,
    protocol: str,
    said: bytes,
    value: dict[str, float],
) -> None:
    (tmp_path / "said.log").write_bytes(said)
    ended = installed("decode", protocol, tmp_path / "said.log", "--json")
    assert ended.returncode == 0, ended.stderr
    lines = [json.loads(line) for line in ended.stdout.splitlines()]
    assert (
        any(line.items() >= value.items() for line in lines[:-1])
        and lines[-1]["counts"]["accepted"] >= 1
    )
    device = {
        "two_fields": "heads: {protocol: two_fields, ports: [COM3]}",
        "plain_fix": "gnss: {protocol: plain_fix, port: COM3}",
    }[protocol]
    cab = tmp_path / "cab.yaml"
    cab.write_text(f"format: topdress-cab/1\n{device}\n")
    assert installed("check", cab).returncode == 0, installed("check", cab).stderr
    cab.write_text(f"format: topdress-cab/1\n{device.replace(protocol, 'nobodys')}\n")
    refused = installed("check", cab)
    assert refused.returncode == 2 and "'nobodys': allowed is one of" in refused.stderr


def test_a_format_is_read_as_a_map(installed: Callable[..., Ran], tmp_path: Path) -> None:
    (tmp_path / "a.squares").write_text("117 40 0.001 120\n117.001 40 0.001 80\n")
    ended = installed("map", tmp_path / "a.squares", "--out", tmp_path / "a.geojson")
    assert ended.returncode == 0, ended.stderr
    made = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert [one["properties"]["rate_kg_ha"] for one in made] == [120.0, 80.0]
    (tmp_path / "a.squares").write_text("117 40\n")
    refused = installed("map", tmp_path / "a.squares")
    assert (
        refused.returncode == 2
        and "not readable by the plug-in of .squares: not enough values" in refused.stderr
    )


@pytest.mark.exam
def test_an_effect_is_planted_and_what_is_found_like_it_is_named(
    installed: Callable[..., Ran], tmp_path: Path
) -> None:
    term = "flow_percent bend speed_mps bend=-9 at=1.2"
    for name, words in (("a", ("--effect", "example.fast=-9")), ("b", ("--term", term))):
        ended = installed(
            "simulate", "--seconds", "60", "--seed", "3", *words, "--out", tmp_path / f"{name}.csv"
        )
        assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    said = [
        installed(one, code=SAID).stdout.strip()
        for one in (term, term.replace("speed_mps", "hopper_kg"))
    ]
    assert [
        one.endswith(" (Flutes fill less when it goes fast: drive slower)") for one in said
    ] == [True, False]
    refused = installed("simulate", "--effect", "example.fast=much")
    assert refused.returncode == 2 and refused.stderr.startswith(
        "effect 'example.fast=much': allowed is example.fast="
    )


@pytest.mark.exam
def test_a_plug_in_that_does_not_load_is_said_in_one_line(installed: Callable[..., Ran]) -> None:
    refused = installed("simulate", "--effect", "example.broken=1")
    assert refused.returncode == 2 and refused.stderr.startswith(
        "plug-in example.broken of topdress-example: not loaded: AttributeError: "
    )
    assert "Flutes fill less when it goes fast" in installed("effects").stdout
