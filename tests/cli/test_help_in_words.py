"""Help that a person can use: examples that parse, words for types, one place for exit codes,
no terminal needed."""

from __future__ import annotations

import io
import re
import shlex
from pathlib import Path

import pytest
import typer
from topdress.console.cli import EXAMPLES, app, describe_ranges, make_requested_app, plain_output
from topdress.console.cli.plain_errors import EXIT_OUR_FAULT, guard_command
from typer.testing import CliRunner

from tests.command import topdress
from tests.places import PAPERS

TYPES = re.compile(r"<(str|int|float|path|list|Path)|int range|float range")


def said(*words: str) -> str:
    done = topdress(*words, env={"COLUMNS": "120"})
    assert done.exit_code == 0, done.output
    return done.output


def test_every_command_has_examples_and_no_others_do():
    def names(text: str) -> list[str]:
        return re.findall(r"^  ([\w-]+)  ", text.split("Commands:")[1], re.MULTILINE)

    calibrations = {f"calibrate {name}" for name in names(said("calibrate", "--help"))}
    assert (set(names(said("--help"))) - {"calibrate"}) | calibrations == set(EXAMPLES)


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_help_is_in_words_and_its_examples_stand_a_line_each(name):
    text = said(*name.split(), "--help")
    assert not TYPES.search(text), TYPES.search(text)
    for line in EXAMPLES[name]:
        assert f"\n    {line}\n" in text + "\n"


@pytest.mark.parametrize("line", sorted(line for lines in EXAMPLES.values() for line in lines))
def test_every_word_of_an_example_is_known_to_its_command(line):
    """Options that stand in an example stand in the help of its command."""
    program, *words = shlex.split(line)
    name = next(
        name
        for name in sorted(EXAMPLES, key=len, reverse=True)
        if words[: len(name.split())] == name.split()
    )
    text = said(*name.split(), "--help")
    assert program == "topdress"
    assert all(f"{word} " in text for word in words if word.startswith("--"))


def test_help_tells_the_exit_codes_and_completion():
    text = " ".join(said("--help").split())
    for wanted in (
        "0 done",
        "1 a disk, port or line failed",
        "2 what was given is wrong",
        "3 nothing of the data",
        "70 a fault of topdress itself",
        "130 cancelled",
        "--install-completion",
    ):
        assert wanted in text


@pytest.mark.parametrize("words", [["run"], ["replay", "good.csv"], []])
def test_what_draws_on_a_terminal_says_that_it_needs_one(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert topdress("simulate", "--seconds", "2", "--out", "good.csv").exit_code == 0
    done = topdress(*words)
    assert done.exit_code == 2 and "needs a terminal; without one: topdress" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_simulate_says_what_it_wrote(tmp_path):
    log = tmp_path / "run.csv"
    done = topdress("simulate", "--seconds", "2", "--out", log)
    for name in ("run.csv", "run.yaml", "run.truth.csv"):
        assert str(tmp_path / name) in done.stdout and (tmp_path / name).exists()


def test_a_fault_of_ours_is_one_line_with_the_place_of_its_trace(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def broken() -> None:
        raise KeyError("speed")

    with pytest.raises(typer.Exit) as ended:
        guard_command(broken)()
    assert ended.value.exit_code == EXIT_OUR_FAULT
    [line] = capsys.readouterr().err.splitlines()
    [kept] = tmp_path.iterdir()
    assert line.startswith("a fault of topdress: KeyError: 'speed'") and str(kept) in line
    assert "in broken" in kept.read_text()


def drawn(text: str, columns: int, complains: bool, monkeypatch, **environment: str) -> str:
    """What stands on a terminal of so many columns."""
    held = io.BytesIO()
    # only here: pytest asks for the terminal's size as well
    with monkeypatch.context() as here:
        here.setenv("COLUMNS", str(columns))
        here.delenv("NO_COLOR", raising=False)
        here.setenv("TERM", "xterm")
        for name, value in environment.items():
            here.setenv(name, value)
        screen = plain_output.PlainOutput(held, encoding="utf-8", line_buffering=True)
        screen.complains = complains
        screen.write(text)
        screen.flush()
    return held.getvalue().decode()


def test_wide_output_breaks_between_words(monkeypatch):
    text = (
        "the shaft turns six per cent slower than the machine file says, by the wheel and "
        "by the scale\n"
    )
    rows = drawn(text, 40, False, monkeypatch).splitlines()
    assert all(len(row) <= 40 for row in rows) and " ".join(" ".join(rows).split()) == text.strip()
    assert all(row.startswith(plain_output.CONTINUATION) for row in rows[1:])


def test_complaints_are_in_colour_and_colour_can_be_refused(monkeypatch):
    assert (
        drawn("field.csv: no rate\n", 80, True, monkeypatch)
        == "\x1b[31mfield.csv: no rate\x1b[0m\n"
    )
    assert drawn("note: two rows left out\n", 80, True, monkeypatch).startswith("\x1b[34m")
    assert drawn("all well\n", 80, False, monkeypatch) == "all well\n"
    assert (
        drawn("field.csv: no rate\n", 80, True, monkeypatch, NO_COLOR="1") == "field.csv: no rate\n"
    )


def test_nothing_in_a_line_steers_the_terminal(monkeypatch):
    assert "\x1b[2J" not in drawn("a\x1b[2Jb\n", 80, True, monkeypatch)


def test_ranges_are_told_in_words_and_texts_stay_in_their_column():
    assert describe_ranges("[default: 10; 1<=x<=100]") == "[default: 10; from 1 to 100]"
    assert (
        describe_ranges("[0.2<=x<=60.0] [x>=0] [x<=9.5]")
        == "[from 0.2 to 60] [0 or more] [at most 9.5]"
    )
    assert describe_ranges("[1e-06<=x<=1e+4]") == "[from 1e-06 to 1e+4]"
    assert describe_ranges("[300<=x<=4000000]") == "[from 300 to 4000000]"
    for name in EXAMPLES:
        text = said(*name.split(), "--help")
        assert "<=x" not in text and "x>=" not in text and "None:" not in text, name
    arguments = (
        said("decode", "--help").split("Arguments:")[1].split("Options:")[0].strip().splitlines()
    )
    starts = {re.search(r"\S+ +", line.strip()).end() for line in arguments}
    assert len(starts) == 1, "both descriptions begin in one column"


@pytest.mark.parametrize(
    "words",
    [
        ["run", "--help"],
        ["map", "-h"],
        ["--version"],
        ["calibrate", "lag", "--help"],
        ["rnu"],
        ["run", "--hz", "500"],
        ["decode"],
    ],
)
def test_one_command_alone_says_what_the_whole_says(words):
    env = {"COLUMNS": "120"}
    alone, whole = (
        CliRunner().invoke(one, words, env=env, prog_name="topdress")
        for one in (make_requested_app(words, {}), app)
    )
    assert (alone.exit_code, alone.output) == (whole.exit_code, whole.output)


def test_only_the_command_that_is_asked_for_is_made_ready():
    assert [
        one.name for one in make_requested_app(["run", "--hz", "20"], {}).registered_commands
    ] == ["run"]
    assert [one.name for one in make_requested_app([], {}).registered_commands] == ["run"], (
        "without a command: the console"
    )
    for words, environment in (
        (["--help"], {}),
        (["rnu"], {}),
        (["calibrate"], {}),
        ([], {"_TOPDRESS_COMPLETE": "x"}),
    ):
        assert make_requested_app(words, environment) is app


# --- Every table of the papers goes through diagnose and calibrate: an answer or one plain line
# ----------------

TABLES = sorted(PAPERS.glob("*.csv"))
ANSWERED = {
    "diagnose": {
        "decision_table2_applied",
        "lag_table1_distance",
        "lag_table2_response",
        "lag_table3_drop_time",
        "lag_table4_total",
        "lag_table5_corrected",
        "lag_table6_gain",
    },
    "lag": {"lag_table1_distance", "lag_table3_drop_time"},
    "catch": set(),
    "wheel": set(),
    "heads": set(),
}


@pytest.mark.parametrize("command", ANSWERED)
@pytest.mark.parametrize("table", TABLES, ids=lambda path: path.stem)
def test_an_answer_or_one_plain_line(table: Path, command: str, tmp_path: Path) -> None:
    out = tmp_path / "new.yaml"
    arguments = (
        ["diagnose", str(table)]
        if command == "diagnose"
        else ["calibrate", command, str(table), "--out", str(out)]
    )
    told = topdress(*arguments)
    assert told.exception is None or isinstance(told.exception, SystemExit)
    if table.stem in ANSWERED[command]:
        assert told.exit_code == 0 and told.stdout
        return
    assert told.exit_code == 2 and not out.exists()
    assert len(told.stderr.splitlines()) == 1 and table.name in told.stderr


def test_a_table_that_holds_no_drop_time_is_told_so_before_its_labels(tmp_path: Path) -> None:
    told = topdress(
        "calibrate", "lag", PAPERS / "lag_table2_response.csv", "--out", tmp_path / "new.yaml"
    )
    assert "response_s holds no drop time" in told.stderr
