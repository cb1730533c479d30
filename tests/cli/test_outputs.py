"""No command writes over a file that it reads, whatever the two are called, nor over others
untold."""

from __future__ import annotations

import inspect
import json
import os
import shutil
import typing
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import typer
from serial.tools.list_ports_common import ListPortInfo
from topdress.console.cli import app
from topdress.control.machine.history import append_history
from topdress.control.machine.machine import Machine, add_effect
from topdress.drivers.files.config import find_shipped_files, save_config
from topdress.drivers.files.config_kinds import MACHINE_KIND
from topdress.drivers.files.prescriptions.map_reader import read_prescription
from topdress.drivers.files.prescriptions.map_writer import write_prescription
from typer.models import OptionInfo
from typer.testing import Result

from tests.command import topdress

SHORT = ("--seconds", "1")
# command -> arguments that name each of its inputs, in the folder of `place`
INPUTS = {
    "simulate": ("--job", "job.yaml", "--machine", "machine.yaml", *SHORT),
    "replay": ("run.csv", "--headless", "--job", "job.yaml", "--machine", "machine.yaml"),
    "diagnose": (
        "run.csv",
        "--machine",
        "machine.yaml",
        "--closed-loop",
        "60",
        "--job",
        "job.yaml",
    ),
    "calibrate": ("catch", "catch.csv", "--machine", "machine.yaml"),
    "map": ("run.csv", "--machine", "machine.yaml"),
    "check": ("machine.yaml", "machine.json"),
    "history": ("machine.yaml", "--undo"),
    "serve-machine": ("--job", "job.yaml", "--machine", "machine.yaml", *SHORT, "--port", "0"),
    "effects": ("--machine", "./machine.yaml"),
    "reproduce": (),
    "trial": ("plan.geojson", "run.csv", "catch.csv", "--machine", "machine.yaml"),
    "record": ("run.csv", "--machine", "machine.yaml"),
    "field": ("plan.geojson", "--job", "job.yaml"),
    "import": ("other.csv", "--mapping", "import.yaml"),
    "import --guess": ("other.csv",),
    "compare": ("machine.yaml", "huanghai", "run.csv"),
    "machine": ("--from", "run.csv", "--yes"),
}
OF_JOB = ("job.yaml", "crop.yaml", "weather.csv", "plan.geojson")
READ = {  # and the files that it reads with them
    "simulate": (*OF_JOB, "machine.yaml"),
    "replay": ("run.csv", "run.yaml", *OF_JOB, "machine.yaml"),
    "diagnose": ("run.csv", "run.yaml", *OF_JOB, "machine.yaml"),
    "calibrate": ("catch.csv", "machine.yaml"),
    "map": ("run.csv", "run.yaml", "machine.yaml"),
    "check": ("machine.yaml", "machine.json"),
    "history": ("machine.yaml",),
    "effects": ("machine.yaml",),
    "serve-machine": (*OF_JOB, "machine.yaml"),
    "field": ("plan.geojson", "job.yaml"),
    "record": ("run.csv", "run.yaml", "machine.yaml"),
    "trial": ("plan.geojson", "run.csv", "run.yaml", "catch.csv", "machine.yaml"),
    "import": ("other.csv", "import.yaml"),
    "import --guess": ("other.csv",),
    "compare": ("machine.yaml", "run.csv", "run.yaml"),
    "machine": ("run.csv",),
}
WRITES = {  # every option that names an output
    ("simulate", "--out"),
    ("replay", "--out"),
    ("diagnose", "--json"),
    ("diagnose", "--report"),
    ("diagnose", "--adopt"),
    ("calibrate", "--out"),
    ("map", "--out"),
    ("check", "--write-schemas"),
    ("history", "--out"),
    ("serve-machine", "--pty"),
    ("effects", "--markdown"),
    ("reproduce", "--out"),
    ("import", "--out"),
    ("import --guess", "--mapping"),
    ("compare", "--report"),
    ("machine", "--out"),
    ("field", "--out"),
    ("record", "--out"),
    ("trial", "--out"),
}
# The worker takes a free name; never written over; a folder of several files, below.
ELSEWHERE = {("run", "--log"), ("serve", "--token-file"), ("fleet", "--out")}
INPUT = {("machine", "--from"), ("trial", "--after")}  # though it is an option of a path
# their --out is a table, whose name ends in .csv
LOGS = {"simulate", "replay", "import", "record"}
FOLDERS = {("check", "--write-schemas"), ("serve-machine", "--pty"), ("reproduce", "--out")}


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("originals")
    shutil.copy(find_shipped_files("machines")["huanghai"], folder / "machine.yaml")
    shutil.copy(find_shipped_files("machines")["huanghai"], folder / "machine.json")
    crop = find_shipped_files("crops")["huanghai_wheat"].read_text(encoding="utf-8")
    (folder / "crop.yaml").write_text(_counted_from_weather(crop), encoding="utf-8")
    (folder / "weather.csv").write_text(
        "date,mean_temp_c\n" + "".join(f"2013-11-{day:02d},9.0\n" for day in range(1, 31))
    )
    ring = [[116.0, 40.0], [116.001, 40.0], [116.001, 40.001], [116.0, 40.001], [116.0, 40.0]]
    (folder / "plan.geojson").write_text(
        json.dumps(
            {
                "type": "FeatureCollection",
                "features": [
                    {
                        "type": "Feature",
                        "properties": {"rate": 200.0},
                        "geometry": {"type": "Polygon", "coordinates": [ring]},
                    }
                ],
            }
        )
    )
    (folder / "job.yaml").write_text(
        "format: topdress-job/1\nid: j\ncrop: ./crop.yaml\ntarget:\n  source: canopy\n"
        "  map: plan.geojson\n",
        encoding="utf-8",
    )
    (folder / "catch.csv").write_text(
        "shaft_rpm,opening_mm,duration_s,mass_kg\n"
        + "".join(
            f"{rpm},{mm},60,{5.9e-3 * mm * rpm:.4f}\n"
            for rpm in (30, 60)
            for mm in (10, 20, 40)
            for _ in range(3)
        )
    )
    (folder / "other.csv").write_text(
        "Time [s];Shaft speed [rpm]\n" + "".join(f"{k};{20 + k % 9}\n" for k in range(99))
    )
    (folder / "import.yaml").write_text(
        "format: topdress-import/1\ntime: {column: 'Time [s]', counts: s}\n"
        "columns: {shaft_rpm: {from: 'Shaft speed [rpm]'}}\n"
    )
    done = topdress("simulate", "--seconds", "30", "--out", folder / "run.csv")
    assert done.exit_code == 0, done.output
    return folder


def _counted_from_weather(crop: str) -> str:
    import yaml

    told = yaml.safe_load(crop)
    told["days"] = {"weather": "weather.csv", "sown": "2013-11-01", "sensed": "2013-11-30"}
    return yaml.safe_dump(told)


@pytest.fixture
def place(originals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The originals in the working folder; at the end not a byte of them is another one."""
    folder = tmp_path / "work"
    shutil.copytree(originals, folder)
    monkeypatch.chdir(folder)
    yield folder
    for file in originals.iterdir():
        assert (folder / file.name).read_bytes() == file.read_bytes(), file.name


def invoke(command: str, *more: object) -> Result:
    return topdress(*command.split(), *INPUTS[command], *more)


def refused(result: Result) -> str:
    lines = [line for line in result.output.splitlines() if line.strip()]
    assert result.exit_code == 2 and len(lines) == 1, result.output
    return lines[0]


def test_every_option_that_names_an_output_is_tried_here() -> None:
    """Inputs are arguments, or options of texts (a shipped name or a path): an option of a path
    is an output."""
    built = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    commands = [(one.name, one, built[one.name]) for one in app.registered_commands]
    for group in app.registered_groups:  # calibrate, and each of its kinds
        commands += [
            (group.name, one, built[group.name].commands[one.name])
            for one in group.typer_instance.registered_commands
        ]
    found = set()
    for said, command, parsed in commands:
        assert command.callback is not None
        function = inspect.unwrap(command.callback)
        hints = typing.get_type_hints(
            function, vars(inspect.getmodule(function)), include_extras=True
        )
        for name, hint in hints.items():
            option = next(
                (one for one in getattr(hint, "__metadata__", ()) if isinstance(one, OptionInfo)),
                None,
            )
            if option is not None and Path in (hint.__origin__, *typing.get_args(hint.__origin__)):
                found.add((said, next(one.opts[0] for one in parsed.params if one.name == name)))
    tried = {(command.split()[0], option) for command, option in WRITES}
    assert found | {("run", "--log")} == tried | ELSEWHERE | INPUT


@pytest.mark.parametrize("theirs", ["report.html", "logs.parquet", "machines.parquet"])
def test_a_fleet_leaves_files_alone_that_it_did_not_make(place: Path, theirs: str) -> None:
    (place / "season").mkdir()
    (place / "season" / theirs).write_bytes(b"somebody's")
    done = topdress("fleet", "run.csv", "--out", "season")
    assert "exists already" in refused(done)
    assert (place / "season" / theirs).read_bytes() == b"somebody's"
    (place / "season" / "logs.parquet").write_bytes((place / "run.csv").read_bytes())
    done = topdress("fleet", "season/logs.parquet", "--out", "season", "--force")
    assert "is read" in refused(done)


def itself(file: Path) -> str:
    return file.name


def absolute(file: Path) -> str:
    return str(file)


def round_about(file: Path) -> str:
    return f"../{file.parent.name}/./{file.name}"


def symbolic_link(file: Path) -> str:
    file.with_name("link" + file.suffix).symlink_to(file.name)
    return "link" + file.suffix


def linked_folder(file: Path) -> str:
    (file.parent.parent / "other").symlink_to(file.parent)
    return f"../other/{file.name}"


def hard_link(file: Path) -> str:
    os.link(file, file.with_name("hard" + file.suffix))
    return "hard" + file.suffix


ALIASES = (itself, absolute, round_about, symbolic_link, linked_folder, hard_link)


# Every name that a file can have is tried with two commands of the quick set, two names with
# each command.
ALL_NAMES, TWO_NAMES = {("map", "--out"), ("calibrate", "--out")}, {itself, symbolic_link}


@pytest.mark.parametrize(
    ("command", "option", "alias"),
    [
        pytest.param(
            *one, alias, marks=() if one in ALL_NAMES or alias in TWO_NAMES else pytest.mark.exam
        )
        for one in sorted(WRITES - FOLDERS)
        for alias in ALIASES
    ],
)
def test_an_output_that_is_an_input_is_refused(
    place: Path, command: str, option: str, alias: Callable[[Path], str]
) -> None:
    force = alias in (itself, round_about, symbolic_link, hard_link)
    for name in READ[command]:
        out = alias(place / name)
        result = invoke(command, option, out, *(["--force"] if force else []))
        if command in LOGS and not out.endswith(".csv"):
            assert "ends in .csv" in refused(result)
        else:
            assert Path(out).name in refused(result)
        for link in ("link", "hard"):
            (place / (link + (place / name).suffix)).unlink(missing_ok=True)
        (place.parent / "other").unlink(missing_ok=True)


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize(
    ("command", "name"),
    [
        *(
            (command, name)
            for command in ("simulate", "replay")
            for name in ("job", "machine", "crop")
        ),
        ("import", "import"),
    ],
)
def test_nor_is_a_file_beside_the_output(place: Path, command: str, name: str, force: bool) -> None:
    """The sidecar of NAME.csv is NAME.yaml."""
    assert f"{name}.yaml" in refused(
        invoke(command, "--out", f"{name}.csv", *(["--force"] if force else []))
    )
    assert not (place / f"{name}.csv").exists()


def test_nor_the_truth_beside_a_simulated_log(place: Path) -> None:
    shutil.copy("weather.csv", "a.truth.csv")
    crop = Path("crop.yaml").read_text(encoding="utf-8")
    Path("crop2.yaml").write_text(crop.replace("weather.csv", "a.truth.csv"), encoding="utf-8")
    Path("job2.yaml").write_text(
        Path("job.yaml").read_text(encoding="utf-8").replace("crop.yaml", "crop2.yaml")
    )
    result = topdress("simulate", "--job", "job2.yaml", *SHORT, "--out", "a.csv", "--force")
    assert "a.truth.csv" in refused(result)
    assert (place / "a.truth.csv").read_bytes() == (place / "weather.csv").read_bytes()


@pytest.mark.parametrize("command", ["simulate", "replay"])
def test_nor_the_name_that_a_log_has_until_it_is_whole(place: Path, command: str) -> None:
    before = (place / "machine.yaml").read_bytes()
    shutil.copy("machine.yaml", ".a.part.yaml")
    result = topdress(command, *INPUTS[command], "--machine", "./.a.part.yaml", "--out", "a.csv")
    assert result.exit_code == 0, result.output
    assert (place / ".a.part.yaml").read_bytes() == before and (place / "a.csv").exists()


@pytest.mark.parametrize("force", [False, True])
def test_nor_a_file_in_a_folder_that_is_written(place: Path, force: bool) -> None:
    more = ["--force"] if force else []
    assert "machine.json" in refused(invoke("check", "--write-schemas", ".", *more))
    shutil.copy("machine.yaml", "gnss")
    assert "gnss" in refused(
        topdress("serve-machine", "--machine", "./gnss", *SHORT, "--port", "0", "--pty", ".", *more)
    )
    assert (place / "gnss").read_bytes() == (place / "machine.yaml").read_bytes()


@pytest.mark.parametrize("form", ["plan.shp", "task", "task.zip"])
@pytest.mark.parametrize("force", [False, True])
def test_a_map_is_not_converted_onto_itself(place: Path, form: str, force: bool) -> None:
    """Nor onto one of the files that belong to it."""
    source = place / "in" / form
    source.parent.mkdir()
    write_prescription(read_prescription(place / "plan.geojson").data, source)
    before = {file: file.read_bytes() for file in source.parent.rglob("*") if file.is_file()}
    for file in (source, *before):
        result = topdress("map", source, "--out", file, *(["--force"] if force else []))
        assert result.exit_code == 2 and len(result.output.splitlines()) == 1, (file, result.output)
    assert {
        file: file.read_bytes() for file in source.parent.rglob("*") if file.is_file()
    } == before


@pytest.mark.parametrize(("command", "option"), sorted(WRITES - FOLDERS))
def test_what_is_there_already_stays(place: Path, command: str, option: str) -> None:
    ending = ".csv" if command in LOGS else ".html" if option == "--report" else ".yaml"
    mine = place / f"mine{ending}"
    mine.write_text("mine\n")
    assert "exists already" in refused(invoke(command, option, mine))
    assert mine.read_text() == "mine\n"


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("simulate", ("--out", "a.csv")),
        ("replay", ("--out", "a.csv")),
        ("map", ("--out", "a.geojson")),
        ("effects", ("--markdown", "a.md")),
        ("check", ("--write-schemas", "a")),
        ("import", ("--out", "a.csv")),
    ],
)
def test_a_second_time_a_command_replaces_what_it_made(
    place: Path, command: str, options: tuple[str, str]
) -> None:
    inputs = ("machine.yaml",) if command == "check" else INPUTS[command]
    first, second = (topdress(command, *inputs, *options) for _ in range(2))
    assert (first.exit_code, second.exit_code) == (0, 0), first.output + second.output


def test_the_log_of_a_drive_is_replaced_only_when_told(place: Path) -> None:
    shutil.copy("run.csv", "field.csv")
    told = Path("run.yaml").read_text(encoding="utf-8")
    Path("field.yaml").write_text(
        told.replace("started_utc:\n", "started_utc: 2026-03-01T08:00:00.000Z\n").replace(
            "started_utc: null", "started_utc: 2026-03-01T08:00:00.000Z"
        ),
        encoding="utf-8",
    )
    assert "started_utc: 2026" in Path("field.yaml").read_text(encoding="utf-8")
    before = Path("field.csv").read_bytes()
    assert "field.csv: exists already" in refused(invoke("simulate", "--out", "field.csv"))
    assert Path("field.csv").read_bytes() == before
    assert invoke("simulate", "--out", "field.csv", "--force").exit_code == 0
    assert Path("field.csv").read_bytes() != before


def test_an_imported_log_is_made_anew_of_the_same_files_only(place: Path) -> None:
    assert invoke("import", "--out", "a.csv").exit_code == 0
    before = Path("a.csv").read_bytes()
    Path("later.csv").write_text(Path("other.csv").read_text().replace(";20", ";70"))
    later = ["import", "later.csv", "--mapping", "import.yaml", "--out", "a.csv"]
    assert "a.csv: exists already" in refused(topdress(*later))
    assert Path("a.csv").read_bytes() == before
    assert topdress(*later, "--force").exit_code == 0
    assert Path("a.csv").read_bytes() != before


def test_a_guess_is_never_replaced_untold(place: Path) -> None:
    """What was put right in it by hand would be lost."""
    assert invoke("import --guess", "--mapping", "a.yaml").exit_code == 0
    guessed = Path("a.yaml").read_bytes()
    Path("a.yaml").write_bytes(guessed + b"# by hand\n")
    assert "a.yaml: exists already" in refused(invoke("import --guess", "--mapping", "a.yaml"))
    assert invoke("import --guess", "--mapping", "a.yaml", "--force").exit_code == 0
    assert Path("a.yaml").read_bytes() == guessed


def test_nor_the_companion_of_an_imported_shapefile(place: Path) -> None:
    write_prescription(read_prescription(place / "plan.geojson").data, place / "points.shp")
    os.link("points.dbf", "a.csv")
    result = topdress("import", "points.shp", "--out", "a.csv", "--force")
    assert "points.dbf" in refused(result)


def test_a_log_may_lie_in_the_folder_of_its_task(place: Path) -> None:
    assert invoke("map", "--out", "task").exit_code == 0
    for _ in range(2):
        result = topdress("import", "task", "--out", "task/log.csv", "--force")
        assert result.exit_code == 0, result.output


def test_two_outputs_of_one_command_have_two_places(place: Path) -> None:
    assert "two outputs" in refused(invoke("diagnose", "--json", "a.html", "--report", "./a.html"))
    assert not (place / "a.html").exists()


# --- The answer as JSON
# ----------------------------------------------------------------------------------------------

# They draw, serve or ask; live says nothing but JSON.
NO_ANSWER = {"run", "replay", "serve", "serve-machine", "machine", "calibrate encoder", "live"}


def test_every_command_that_answers_does_so_as_json_too() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    every = commands | {
        f"calibrate {name}": one for name, one in commands["calibrate"].commands.items()
    }
    silent = {
        name
        for name, one in every.items()
        if "--json" not in [word for option in one.params for word in option.opts]
    }
    assert silent == NO_ANSWER | {"calibrate"}


# diagnose, compare, watch, trial and decode: their own tests
@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("simulate --seconds 2", {"rate_error_kg_ha", "alarm_ticks"}),
        ("map run.csv", {"applied_kg"}),
        ("map plan.geojson", {"rates", "fallbacks"}),
        ("effects", {"id", "physics"}),
        ("info", {"folders"}),
        ("extras", {"line"}),
        ("check job.yaml machine.yaml", {"ok", "notes", "wrong"}),
        ("check bad.yaml", {"ok", "notes", "wrong"}),
        ("history new.yaml", {"effects", "terms", "data"}),
        ("history new.yaml --undo --out old.yaml", {"effects", "terms", "data"}),
        ("record run.csv --out farm.csv", {"kilograms", "nitrogen_kg"}),
        ("devices --no-probe", {"port", "said"}),
        ("field plan.geojson --out a.yaml", {"title", "area_ha", "outline_deg"}),
        ("field plan.geojson --done", {"done_ha"}),
        ("import --guess other.csv", {"unsure", "questions"}),
        ("import run.csv --out a.parquet", {"rows"}),
        ("import other.csv --mapping import.yaml --out a.csv", {"rows", "duration_s", "columns"}),
        ("calibrate catch catch.csv --out a.yaml", {"grams_per_rev_mm"}),
        ("calibrate lag lag.csv --out a.yaml", {"lag", "tube"}),
        # It starts a scheduler and a worker of its own.
        pytest.param(
            "fleet run.csv --out season --workers 1", {"machines", "fit"}, marks=pytest.mark.exam
        ),
    ],
)
def test_json_stands_alone_on_standard_output(
    place: Path, words: str, names: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [ListPortInfo("/dev/ttyS9")])
    Path("bad.yaml").write_text("format: topdress-machine/1\nflow: {gain_percent: 700}\n")
    after = add_effect(Machine(), "flow.gain", 3.0)
    save_config(
        Path("new.yaml"),
        append_history(Machine(), after, data="run.csv", date="2026-07-09"),
        MACHINE_KIND,
    )
    Path("lag.csv").write_text(
        "shaft_rpm,lag_s\n"
        + "".join(
            f"{rpm},{2.2118 - 0.0083 * rpm + 0.01 * k:.3f}\n"
            for rpm in range(10, 80, 10)
            for k in (-1, 0, 1)
        )
    )
    done = topdress(*words.split(), "--json")
    assert done.exit_code == (2 if "bad" in words else 0), done.output
    found = json.loads(done.stdout)
    assert names <= set(found[0] if isinstance(found, list) else found)
