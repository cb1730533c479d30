"""How does topdress read and write YAML? It applies YAML 1.2 scalars, refuses duplicate keys and
bombs, and knows the line of every key.

PyYAML's own rules are those of YAML 1.1, where `off` is false, `12:30` is 750, `010` is 8 and `1e3`
is a text.
"""

from __future__ import annotations

import re
from typing import Any

import yaml
from topdress.drivers.files.limits import YAML_NODES_LIMIT
from topdress.drivers.plain_text import OneLineError

KeyPath = tuple[str | int, ...]

# Largest depth of groups within groups; deeper files are bombs.
MAX_YAML_DEPTH = 40


# Beginning of the tags of plain data.
_TAG_PREFIX = "tag:yaml.org,2002:"
_KEY_TAGS = frozenset(_TAG_PREFIX + name for name in ("str", "int", "float", "bool", "merge"))
_PLAIN_TAGS = _KEY_TAGS | {_TAG_PREFIX + name for name in ("null", "seq", "map")}


class YamlError(OneLineError):
    """Reports a text that is no supported YAML, with the line of the file."""


class _Loader(yaml.SafeLoader):
    """Counts nodes while they are composed, because a text of 2 MB makes 900 000 nodes, which need
    600 MB."""

    nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        self.nodes += 1
        if self.nodes > YAML_NODES_LIMIT.most:
            raise YamlError(f"line {self.line + 1}: nested too deeply or too large")
        return super().compose_node(parent, index)

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}


# Numbers of YAML 1.2; an exponent needs no point.
_FLOAT_PATTERN = re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$")

_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"^(true|True|TRUE|false|False|FALSE)$"), list("tTfF")
)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:null", re.compile(r"^(~|null|Null|NULL|)$"), ["~", "n", "N", ""]
)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:int", re.compile(r"^[-+]?[0-9]+$"), list("-+0123456789")
)
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT_PATTERN, list("-+0123456789."))
_Loader.add_implicit_resolver("tag:yaml.org,2002:merge", re.compile(r"^<<$"), ["<"])


def _construct_decimal(loader: _Loader, node: yaml.ScalarNode) -> int:
    return int(str(loader.construct_scalar(node)))


_Loader.add_constructor("tag:yaml.org,2002:int", _construct_decimal)


def parse_yaml(text: str) -> tuple[Any, dict[KeyPath, int]]:
    """Returns the data, and the line (from 1) of every path of keys and indexes. Raises YamlError
    for syntax, duplicate keys, tags other than plain data, and too many or too deep nodes."""
    try:
        loader = _Loader(text)
    except yaml.reader.ReaderError as error:
        raise YamlError(f"character {error.position + 1}: not allowed in YAML") from None
    try:
        node = loader.get_single_node()
        if node is None:
            return None, {}
        lines: dict[KeyPath, int] = {}
        _record_lines(node, (), lines, 0)
        return loader.construct_document(node), lines
    except yaml.MarkedYAMLError as error:
        raise YamlError(_format_yaml_error(error)) from None
    except (ValueError, OverflowError, RecursionError) as error:
        if isinstance(error, YamlError):
            raise
        raise YamlError(f"not YAML: {error}") from None
    finally:
        loader.dispose()


def _record_lines(node: yaml.Node, path: KeyPath, lines: dict[KeyPath, int], count: int) -> int:
    """Records lines and refuses duplicates and bombs; returns the number of nodes so far."""
    count += 1
    if node.tag not in _PLAIN_TAGS:
        raise YamlError(
            f"line {node.start_mark.line + 1}: not YAML as read here: tag {node.tag}: "
            "allowed is plain data without tags"
        )
    if count > YAML_NODES_LIMIT.most or len(path) > MAX_YAML_DEPTH:
        raise YamlError(f"line {node.start_mark.line + 1}: nested too deeply or too large")
    lines.setdefault(path, node.start_mark.line + 1)
    if isinstance(node, yaml.SequenceNode):
        for index, child in enumerate(node.value):
            count = _record_lines(child, (*path, index), lines, count)
    elif isinstance(node, yaml.MappingNode):
        seen: dict[str, int] = {}
        for key, child in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode) or key.tag not in _KEY_TAGS or not key.value:
                raise YamlError(f"line {line}: a key must be a name")
            if key.value in seen:
                where = ".".join(str(p) for p in (*path, key.value))
                raise YamlError(
                    f"key {where}: stands twice, in lines {seen[key.value]} and {line}: "
                    "allowed once"
                )
            seen[key.value] = line
            inside = path if key.tag == "tag:yaml.org,2002:merge" else (*path, key.value)
            if inside != path:
                lines[inside] = line
            count = _record_lines(child, inside, lines, count)
    return count


def _format_yaml_error(error: yaml.MarkedYAMLError) -> str:
    """Returns PyYAML's error as a line."""
    mark = error.problem_mark or error.context_mark
    line = f"line {mark.line + 1}: " if mark is not None else ""
    problem = " ".join(str(error.problem or error.context or "").split())
    hint = " (indent with spaces, not tabs)" if "\\t" in problem or "'\t'" in problem else ""
    return f"{line}not YAML: {problem}{hint}"


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


# Lists of numbers are written in one line; texts have escapes where they need them.
_Dumper.add_representer(
    list,
    lambda dumper, data: dumper.represent_sequence(
        "tag:yaml.org,2002:seq",
        data,
        flow_style=all(isinstance(item, int | float) for item in data),
    ),
)
_Dumper.add_representer(
    str,
    lambda dumper, data: dumper.represent_scalar(
        "tag:yaml.org,2002:str", data, style=None if data.isprintable() else '"'
    ),
)
_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT_PATTERN, list("-+0123456789."))


def dump_yaml(data: Any) -> str:
    """Returns plain data as YAML that reads back as the same data under the rules of YAML 1.1 and
    1.2."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
