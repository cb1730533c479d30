from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from drivers.files.yaml_text import YamlProblem, dump_yaml, parse_yaml

treacherous = st.sampled_from(["off", "on", "yes", "1e3", "12:30", "010", "2026-03-20", "~", "<<", "null", "\x85"])
numbers = st.integers(-10**12, 10**12) | st.floats(allow_nan=False, allow_infinity=False)
scalars = st.none() | st.booleans() | numbers | st.text(max_size=20) | treacherous
names = st.text(min_size=1, max_size=10) | treacherous
plain_data = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(names, inner, max_size=4), max_leaves=15)


@given(plain_data)
def test_what_is_written_reads_back_the_same_here_and_elsewhere(data: Any) -> None:
    text = dump_yaml(data)
    assert parse_yaml(text)[0] == data
    assert yaml.safe_load(text) == data


@pytest.mark.parametrize(("text", "value"), [
    ("off", "off"), ("no", "no"), ("true", True), ("12:30", "12:30"), ("010", 10), ("1e3", 1000.0), ("1.5e-3", 0.0015),
    ("2026-03-20", "2026-03-20"), (".inf", ".inf"), ("~", None), ("0x10", "0x10"), ("1_000", "1_000"), ("+5", 5)])
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


@pytest.mark.parametrize(("text", "said"), [
    ("a: 1\nb: 2\na: 3\n", "key a: stands twice, in lines 1 and 3"),
    ("g:\n  a: 1\n  a: 1\n", "key g.a: stands twice, in lines 2 and 3"),
    ("a: [1, 2\n", "line 2: not YAML"),
    ("a: 1\n\tb: 2\n", "line 2: not YAML"),
    ("a: !!python/object:os.system {}\n", "line 1: not YAML"),
    ("a: 1\n---\nb: 2\n", "not YAML"),
    ("? [a, b]\n: 1\n", "a key must be a name"),
    ("a: &x [*x]\n", "nested too deeply"),
    ("a: \x07\n", "not allowed in YAML"),
])
def test_refusals_are_one_line(text: str, said: str) -> None:
    with pytest.raises(YamlProblem) as caught:
        parse_yaml(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bomb_of_aliases_is_refused_quickly() -> None:
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 9))
    with pytest.raises(YamlProblem, match="too large"):
        parse_yaml(bomb)
