import hashlib
from collections.abc import Callable
from datetime import date
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, Field, model_validator
from topdress.control.machine.machine import Machine
from topdress.drivers.files.config import (
    ConfigError,
    ConfigKind,
    calc_sha256,
    find_shipped_files,
    load_any_config,
    load_config,
    make_json_schema,
    resolve_config_path,
    save_config,
    validate_config,
)
from topdress.drivers.files.config_kinds import CONFIG_KINDS as OURS
from topdress.drivers.files.config_kinds import MACHINE_KIND
from topdress.drivers.files.yaml_text import YamlError, dump_yaml, parse_yaml

Written = Callable[..., Path]


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


class Stage(NamedTuple):
    dead_time_s: Annotated[float, Field(ge=0, le=5)] = 0.4
    slow_s: Annotated[float, Field(ge=0, le=3)] = 0.0


class Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Inner(Strict):
    width_m: float = Field(gt=0, le=50)
    outlets: int = Field(default=6, ge=1, le=12)


class Thing(Strict):
    format: Literal["test-thing/1"]
    name: str = Field(min_length=1)
    colour: Colour = Colour.RED
    inner: Inner
    stage: Stage = Stage()
    sown: date | None = None
    rate_kg_ha: float | None = Field(
        default=None, ge=0, le=400, json_schema_extra={"unit": "kg/ha"}
    )
    corners: tuple[tuple[float, float], ...] = ()
    on: bool = True
    span_m: Annotated[float, Field(gt=0)] | tuple[float, float] | Inner = 1.0

    @model_validator(mode="after")
    def _fits(self) -> "Thing":
        if self.name == self.colour:
            raise ValueError("name and colour are the same: allowed are different ones")
        return self


class Bare(Strict):
    size_m: float = 1.0


THING = ConfigKind("test-thing/1", "things", Thing)
BARE = ConfigKind("test-bare/1", "bares", Bare)
KINDS = {kind.format: kind for kind in (THING, BARE)}
GOOD = "format: test-thing/1\nname: a\ninner:\n  width_m: 2.4\n"


def lines_of(path: Path) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        load_config(path, THING)
    assert all("\n" not in line and line.startswith(str(path)) for line in caught.value.lines)
    return tuple(line.removeprefix(f"{path}: ") for line in caught.value.lines)


def test_a_good_file_is_read_with_its_checksum(written: Written) -> None:
    path = written(
        GOOD + "sown: 2025-10-15\ncorners: [[0, 1], [2.5, 3]]\ncolour: blue\nstage: {slow_s: 1}\n",
        "t.yaml",
    )
    loaded = load_config(path, THING)
    assert loaded.model == Thing(
        format="test-thing/1",
        name="a",
        inner=Inner(width_m=2.4),
        colour=Colour.BLUE,
        sown=date(2025, 10, 15),
        corners=((0, 1), (2.5, 3)),
        stage=Stage(slow_s=1.0),
    )
    assert loaded.sha256 == hashlib.sha256(path.read_bytes()).hexdigest() == calc_sha256(path)
    assert load_config("t.yaml", THING, base=path.parent).model == loaded.model


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (
            "rate_kg_ha: 700\n",
            "key rate_kg_ha: value 700: allowed 0 to 400 kg/ha or nothing (line 5)",
        ),
        ("colour: green\n", "key colour: value green: allowed red, blue (line 5)"),
        ("color: red\n", "key color: unknown key; did you mean colour? (line 5)"),
        (
            "zz: 1\n",
            "key zz: unknown key: allowed format, name, colour, inner, stage, sown, "
            "rate_kg_ha, corners, on, "
            "span_m (line 5)",
        ),
        (
            "span_m: x\n",
            "key span_m: value x: allowed more than 0 or a list of 2 or keys width_m, "
            "outlets (line 5)",
        ),
        ("span_m: [1, x]\n", "key span_m[2]: value x: allowed a number (line 5)"),
        (
            "span_m: {width_m: 99}\n",
            "key span_m.width_m: value 99: allowed more than 0 and at most 50 (line 5)",
        ),
        ("on: 1\n", "key on: value 1: allowed true, false (line 5)"),
        ("on: yes\n", "key on: value yes: allowed true, false (line 5)"),
        (
            "rate_kg_ha: true\n",
            "key rate_kg_ha: value true: allowed 0 to 400 kg/ha or nothing (line 5)",
        ),
        (
            "rate_kg_ha: '5'\n",
            'key rate_kg_ha: value "5": allowed 0 to 400 kg/ha or nothing (line 5)',
        ),
        (
            "rate_kg_ha: .nan\n",
            'key rate_kg_ha: value ".nan": allowed 0 to 400 kg/ha or nothing (line 5)',
        ),
        ("rate_kg_ha: 1e999\n", None),
        (
            "sown: 15.10.2025\n",
            'key sown: value "15.10.2025": allowed a date such as 2025-03-20 or nothing (line 5)',
        ),
        ("corners: [[0, 1], [2, x]]\n", "key corners[2][2]: value x: allowed a number (line 5)"),
        ("stage: {slow: 1}\n", "key stage.slow: unknown key; did you mean slow_s? (line 5)"),
        ("stage: {slow_s: 9}\n", "key stage.slow_s: value 9: allowed 0 to 3 (line 5)"),
        ("name: b\n", "key name: stands twice, in lines 2 and 5: allowed once"),
    ],
)
def test_each_mistake_is_one_line(written: Written, more: str, line: str | None) -> None:
    found = lines_of(written(GOOD + more, "t.yaml"))
    assert len(found) == 1
    if line is not None:
        assert found[0] == line


def test_all_mistakes_are_told_in_the_order_of_the_file(written: Written) -> None:
    path = written(
        "format: test-thing/1\nrate_kg_ha: -1\ninner:\n  outlets: 2.5\n  widht_m: 3\n", "t.yaml"
    )
    assert lines_of(path) == (
        "key name: missing: allowed a text, not empty (line 1)",
        "key rate_kg_ha: value -1: allowed 0 to 400 kg/ha or nothing (line 2)",
        "key inner.width_m: missing: allowed more than 0 and at most 50 (line 3)",
        "key inner.outlets: value 2.5: allowed a whole number, 1 to 12 (line 4)",
        "key inner.widht_m: unknown key; did you mean width_m? (line 5)",
    )


def test_rules_of_a_model_speak_for_themselves(written: Written) -> None:
    path = written(GOOD.replace("name: a", "name: red"), "t.yaml")
    assert lines_of(path) == ("name and colour are the same: allowed are different ones (line 1)",)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "the file is empty"),
        (b"- 1\n", "found list"),
        (b"a: \xff\xfe\n", "not UTF-8"),
        (b"a: [\n", "not YAML"),
        (b"name: a\n", "key format: missing: allowed test-thing/1"),
        (
            b"format: test-thing/2\n",
            "key format: value test-thing/2: allowed test-thing/1 (line 1)",
        ),
        (b"#" * 2_000_001, "too large"),
    ],
)
def test_files_that_are_no_configuration(written: Written, content: bytes, said: str) -> None:
    (found,) = lines_of(written(content, "t.yaml"))
    assert said in found


def test_a_file_that_is_there_and_no_configuration_is_not_looked_for_among_names(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.geojson").write_text("{}")
    with pytest.raises(
        ConfigError, match=r"map.geojson: is there, but no configuration: allowed is a .yaml file"
    ):
        resolve_config_path("map.geojson", ["crops"])


def test_a_missing_file_and_an_unknown_name(tmp_path: Path) -> None:
    assert lines_of(tmp_path / "none.yaml") == ("no such file",)
    assert lines_of(tmp_path)[0].startswith("cannot be read")
    with pytest.raises(
        ConfigError, match=r"huanghi_wheat: no configuration of this name.*did you mean huanghai_"
    ):
        load_config("huanghi_wheat", ConfigKind("x/1", "crops", Bare))


def test_any_kind_is_recognised_by_its_format(written: Written) -> None:
    kind, loaded = load_any_config(written("format: test-bare/1\nsize_m: 2\n", "b.yaml"), KINDS)
    assert (kind, loaded.model) == (BARE, Bare(size_m=2.0))
    with pytest.raises(
        ConfigError,
        match="value test-bear/1: allowed test-thing/1, test-bare/1; did you mean test-ba",
    ):
        load_any_config(written("format: test-bear/1\n", "c.yaml"), KINDS)
    with pytest.raises(ConfigError, match="key format: missing"):
        load_any_config(written("size_m: 1\n", "d.yaml"), KINDS)


def test_what_is_saved_reads_back_equal(tmp_path: Path) -> None:
    thing = Thing(
        format="test-thing/1",
        name="off",
        inner=Inner(width_m=1e-7),
        colour=Colour.BLUE,
        sown=date(2025, 1, 2),
        corners=((0.1, 2.0),),
        stage=Stage(1.5, 2.5),
    )
    save_config(tmp_path / "t.yaml", thing, THING, "made by a test\nin two lines")
    assert load_config(tmp_path / "t.yaml", THING).model == thing
    assert (
        (tmp_path / "t.yaml")
        .read_text()
        .startswith("# made by a test\n# in two lines\nformat: test-thing/1\n")
    )
    assert "slow_s: 2.5" in (tmp_path / "t.yaml").read_text()


def test_plain_data_is_validated_alike() -> None:
    assert validate_config(
        {"format": "test-bare/1", "size_m": 3}, BARE, "log.yaml: machine"
    ) == Bare(size_m=3.0)
    with pytest.raises(ConfigError) as caught:
        validate_config({"format": "test-bare/1", "size_m": "x"}, BARE, "log.yaml: machine")
    assert caught.value.lines == ("log.yaml: machine: key size_m: value x: allowed a number",)


def test_the_schema_knows_format_ranges_and_named_tuples() -> None:
    body = make_json_schema(BARE)
    assert body["properties"]["format"] == {"const": "test-bare/1"}
    assert body["required"] == ["format"]
    stage = make_json_schema(THING)["$defs"]["Stage"]
    assert stage["properties"]["dead_time_s"]["maximum"] == 5
    assert stage["additionalProperties"] is False


SHIPPED = [path for kind in OURS.values() for path in find_shipped_files(kind.folder).values()]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_configuration_is_valid_and_survives_a_round_trip(
    path: Path, tmp_path: Path
) -> None:
    kind, loaded = load_any_config(path, OURS)
    assert path.parent.name == kind.folder
    save_config(tmp_path / path.name, loaded.model, kind)
    assert load_config(tmp_path / path.name, kind).model == loaded.model


def test_an_extended_machine_survives_a_round_trip(tmp_path: Path) -> None:
    machine = Machine()
    changed = machine.model_copy(update={"shaft": machine.shaft._replace(slow_s=0.1 + 0.2)})
    save_config(tmp_path / "m.yaml", changed, MACHINE_KIND)
    assert load_config(tmp_path / "m.yaml", MACHINE_KIND).model == changed


@pytest.mark.parametrize("format", OURS)
def test_every_kind_has_a_schema_for_editors(format: str) -> None:
    body = make_json_schema(OURS[format])
    assert body["properties"]["format"]["const"] == format
    assert "format" in body["required"]


treacherous = st.sampled_from(
    ["off", "on", "yes", "1e3", "12:30", "010", "2026-03-20", "~", "<<", "null", "\x85"]
)
numbers = st.integers(-(10**12), 10**12) | st.floats(allow_nan=False, allow_infinity=False)
scalars = st.none() | st.booleans() | numbers | st.text(max_size=20) | treacherous
names = st.text(min_size=1, max_size=10) | treacherous
plain_data = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(names, inner, max_size=4),
    max_leaves=15,
)


@given(plain_data)
def test_what_is_written_reads_back_the_same_here_and_elsewhere(data: Any) -> None:
    text = dump_yaml(data)
    assert parse_yaml(text)[0] == data
    assert yaml.safe_load(text) == data


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("off", "off"),
        ("no", "no"),
        ("true", True),
        ("12:30", "12:30"),
        ("010", 10),
        ("1e3", 1000.0),
        ("1.5e-3", 0.0015),
        ("2026-03-20", "2026-03-20"),
        (".inf", ".inf"),
        ("~", None),
        ("0x10", "0x10"),
        ("1_000", "1_000"),
        ("+5", 5),
    ],
)
def test_scalars_mean_what_an_operator_means(text: str, value: object) -> None:
    data, _ = parse_yaml(f"key: {text}\n")
    assert data["key"] == value
    assert type(data["key"]) is type(value)


def test_lines_of_keys_are_known() -> None:
    _, lines = parse_yaml("a: 1\nb:\n  c: 2\n  d:\n  - x\n  - y\n")
    assert lines[("a",)] == 1
    assert lines[("b", "c")] == 3
    assert lines[("b", "d", 1)] == 6


def test_anchors_and_merges_are_fine_and_may_be_overridden() -> None:
    data, _ = parse_yaml("base: &b {x: 1, y: 2}\nown:\n  <<: *b\n  y: 3\n")
    assert data["own"] == {"x": 1, "y": 3}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: 2\na: 3\n", "key a: stands twice, in lines 1 and 3"),
        ("g:\n  a: 1\n  a: 1\n", "key g.a: stands twice, in lines 2 and 3"),
        ("a: [1, 2\n", "line 2: not YAML"),
        ("a: 1\n\tb: 2\n", "line 2: not YAML"),
        ("a: !!python/object:os.system {}\n", "line 1: not YAML"),
        ("a: 1\n---\nb: 2\n", "not YAML"),
        ("a: 1\nb: !!int [1, 2]\n", "line 2: not YAML"),
        ("? [a, b]\n: 1\n", "a key must be a name"),
        ("a: &x [*x]\n", "nested too deeply"),
        ("a: \x07\n", "not allowed in YAML"),
    ],
)
def test_refusals_are_one_line(text: str, said: str) -> None:
    with pytest.raises(YamlError) as caught:
        parse_yaml(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bomb_of_aliases_is_refused_quickly() -> None:
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 9)
    )
    with pytest.raises(YamlError, match="too large"):
        parse_yaml(bomb)
