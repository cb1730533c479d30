"""How do pydantic's errors appear in an operator's words? Each line has file, key, value, the
permitted values and the line number.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, cast

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from topdress.drivers.files.plain_data import make_model_schema
from topdress.drivers.files.yaml_text import KeyPath

# Largest number of letters of a value in a message.
_MAX_VALUE_LENGTH = 60
# Largest number of keys in a message.
_MAX_NAMES = 15
# Types of errors that the models raise with plain words.
_OWN_ERROR_TYPES = frozenset({"value_error", "assertion_error", "size_of_effect"})


def explain_errors(
    error: ValidationError,
    model: type[BaseModel],
    data: object,
    label: str,
    lines: Mapping[KeyPath, int],
) -> list[str]:
    """Returns a line for each wrong key, in the order of the file."""
    schema = _make_schema(model)
    found: dict[KeyPath, str] = {}
    for detail in error.errors(include_url=False):
        path = _find_key_path(data, detail)
        if path not in found:
            found[path] = _make_sentence(detail, path, data, schema)
    # If one member of a union failed further inside, the file meant that member, and the errors of
    # the other members are omitted.
    outer = {path[:length] for path in found for length in range(len(path))}
    ordered = sorted(
        found.keys() - outer, key=lambda path: (_find_line(path, lines) or 0, str(path))
    )
    return [f"{label}: {found[path]}{_format_line(_find_line(path, lines))}" for path in ordered]


def suggest_nearest(word: str, words: Iterable[str]) -> str:
    """Returns `; did you mean X?` for the nearest word, or an empty text."""
    close = difflib.get_close_matches(word, list(words), n=1, cutoff=0.6)
    return f"; did you mean {close[0]}?" if close else ""


def describe_allowed(sub: Mapping[str, Any] | None, root: Mapping[str, Any]) -> str:
    """Returns the values that a JSON schema permits, in words; empty without a restriction."""
    if sub is None:
        return ""
    sub = _resolve_reference(sub, root)
    if "const" in sub:
        return _format_value(sub["const"])
    if "enum" in sub:
        return ", ".join(_format_value(value) for value in sub["enum"])
    for union in ("anyOf", "oneOf"):
        if union in sub:
            unit = {"unit": sub["unit"]} if "unit" in sub else {}
            words = dict.fromkeys(
                describe_allowed({**option, **unit}, root) for option in sub[union]
            )
            return " or ".join(word for word in words if word)
    kind = str(sub.get("type"))
    return (
        _DESCRIBE_OF_TYPE[kind](sub, root)
        if kind in _DESCRIBE_OF_TYPE
        else _WORDS_OF_TYPE.get(kind, "")
    )


def _make_sentence(
    detail: ErrorDetails, path: KeyPath, data: object, schema: Mapping[str, Any]
) -> str:
    kind, key = detail["type"], _format_key_path(path)
    if kind in ("missing", "missing_argument"):
        words = describe_allowed(_find_subschema(schema, path), schema)
        return f"key {key}: missing{words and f': allowed {words}'}"
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        names = _list_key_names(_find_subschema(schema, path[:-1]), schema)
        listed = f": allowed {', '.join(names)}" if 0 < len(names) <= _MAX_NAMES else ""
        return f"key {key}: unknown key{suggest_nearest(str(path[-1]), names) or listed}"
    value = _find_value(data, path)
    start = f"key {key}: " if path else ""
    if not isinstance(value, dict | list) and value is not _NO_VALUE:
        start += f"value {_format_value(value)}: "
    if kind in _OWN_ERROR_TYPES:
        return start + detail["msg"].removeprefix("Value error, ").removeprefix(
            "Assertion failed, "
        )
    words = describe_allowed(_find_subschema(schema, path), schema)
    return start + (f"allowed {words}" if words else detail["msg"][:1].lower() + detail["msg"][1:])


def _make_schema(model: type[BaseModel]) -> Mapping[str, Any]:
    """Returns the model's JSON schema; empty without a schema."""
    try:
        return make_model_schema(model)
    # A model with parts that no schema describes still gets its lines, without ranges.
    except Exception:
        return {}


# This object means that the data have no such value, because None is a value.
_NO_VALUE = object()


def _find_value(data: object, path: KeyPath) -> object:
    for step in path:
        in_group = isinstance(data, dict) and step in data
        in_list = isinstance(data, list) and isinstance(step, int) and step < len(data)
        if not (in_group or in_list):
            return _NO_VALUE
        data = cast(Any, data)[step]
    return data


def _find_key_path(data: object, detail: ErrorDetails) -> KeyPath:
    """Returns pydantic's location without the names of union members, which are no keys of the
    file."""
    path: list[str | int] = []
    # A model may name the wrong key itself.
    place = (*detail["loc"], *detail.get("ctx", {}).get("wrong_key", ()))
    last = len(place) - 1
    for index, step in enumerate(place):
        inner = _find_value(data, (step,))
        if inner is not _NO_VALUE:
            path.append(step)
            data = inner
        elif index == last and detail["type"].startswith("missing"):
            path.append(step)
    return tuple(path)


def _format_key_path(path: KeyPath) -> str:
    """Returns a path as `a.b[2].c`, with members of lists counted from 1."""
    text = ""
    for step in path:
        text += f"[{step + 1}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def _find_line(path: KeyPath, lines: Mapping[KeyPath, int]) -> int | None:
    """Returns the line of a key, or of the nearest key above it."""
    for length in range(len(path), -1, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return None


def _format_line(line: int | None) -> str:
    return f" (line {line})" if line is not None else ""


def _format_value(value: object) -> str:
    """Returns a value as it would appear in the file."""
    if isinstance(value, str):
        text = value if value[:1].isalpha() and value == value.strip() else f'"{value}"'
    elif value is None:
        text = "nothing"
    else:
        text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _MAX_VALUE_LENGTH else text[: _MAX_VALUE_LENGTH - 3] + "..."


def _resolve_reference(sub: Mapping[str, Any], root: Mapping[str, Any]) -> Mapping[str, Any]:
    while "$ref" in sub:
        target: Any = root
        for part in str(sub["$ref"]).removeprefix("#/").split("/"):
            target = target[part]
        sub = {**target, **{k: v for k, v in sub.items() if k != "$ref"}}
    if len(sub.get("allOf", [])) == 1:
        return _resolve_reference(
            {**sub["allOf"][0], **{k: v for k, v in sub.items() if k != "allOf"}}, root
        )
    return sub


def _iter_options(sub: Mapping[str, Any], root: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yields the schema itself, or the members of a union of schemas."""
    sub = _resolve_reference(sub, root)
    members = [*sub.get("anyOf", []), *sub.get("oneOf", [])]
    if not members:
        yield sub
    for member in members:
        yield from _iter_options(member, root)


def _find_subschema(root: Mapping[str, Any], path: KeyPath) -> Mapping[str, Any] | None:
    """Returns the schema at a path of keys; None for an unknown path."""
    here: Mapping[str, Any] = root
    for step in path:
        for option in _iter_options(here, root):
            inner = _find_inner_schema(option, step)
            if inner is not None:
                here = inner
                break
        else:
            return None
    return here


def _find_inner_schema(sub: Mapping[str, Any], step: str | int) -> Mapping[str, Any] | None:
    if isinstance(step, str):
        inner = sub.get("properties", {}).get(step, sub.get("additionalProperties"))
    else:
        first = sub.get("prefixItems", [])
        inner = first[step] if step < len(first) else sub.get("items")
    return inner if isinstance(inner, Mapping) else None


def _list_key_names(sub: Mapping[str, Any] | None, root: Mapping[str, Any]) -> list[str]:
    if sub is None:
        return []
    return [name for option in _iter_options(sub, root) for name in option.get("properties", {})]


def _allowed_number(sub: Mapping[str, Any], _root: Mapping[str, Any]) -> str:
    low, above = sub.get("minimum"), sub.get("exclusiveMinimum")
    high, below = sub.get("maximum"), sub.get("exclusiveMaximum")
    whole = "a whole number" if sub.get("type") == "integer" else ""
    if low is not None and high is not None:
        limits = f"{_format_figure(low)} to {_format_figure(high)}"
    else:
        parts = []
        if low is not None:
            parts.append(f"at least {_format_figure(low)}")
        if above is not None:
            parts.append(f"more than {_format_figure(above)}")
        if high is not None:
            parts.append(f"at most {_format_figure(high)}")
        if below is not None:
            parts.append(f"less than {_format_figure(below)}")
        limits = " and ".join(parts)
    unit = f" {sub['unit']}" if "unit" in sub else ""
    return (", ".join(part for part in (whole, limits) if part) or "a number") + unit


def _format_figure(number: float) -> str:
    return f"{number:.15g}"


# Examples of dates and times in messages.
_DATE_EXAMPLES = {
    "date": "a date such as 2025-03-20",
    "date-time": "a time such as 2025-03-20T06:30:00Z",
    "time": "a time of day such as 06:30:00",
}


def _allowed_text(sub: Mapping[str, Any], _root: Mapping[str, Any]) -> str:
    if sub.get("format") in _DATE_EXAMPLES:
        return _DATE_EXAMPLES[str(sub["format"])]
    if "pattern" in sub:
        return f"a text of the form {sub['pattern']}"
    low, high = sub.get("minLength"), sub.get("maxLength")
    if low == 1 and high is None:
        return "a text, not empty"
    limits = [
        f"at least {low} characters" if low else "",
        f"at most {high} characters" if high else "",
    ]
    return ", ".join(["a text", *(limit for limit in limits if limit)])


def _allowed_list(sub: Mapping[str, Any], root: Mapping[str, Any]) -> str:
    low, high = sub.get("minItems"), sub.get("maxItems")
    if low is not None and low == high:
        many = f"a list of {low}"
    elif low and high:
        many = f"a list of {low} to {high}"
    elif low:
        many = f"a list of at least {low}"
    elif high:
        many = f"a list of at most {high}"
    else:
        many = "a list"
    items = sub.get("items")
    inner = describe_allowed(items, root) if isinstance(items, Mapping) else ""
    return f"{many}, each {inner}" if inner else many


def _allowed_group(sub: Mapping[str, Any], root: Mapping[str, Any]) -> str:
    names = list(sub.get("properties", {}))
    return f"keys {', '.join(names[:_MAX_NAMES])}" if names else "keys and values"


# Functions that describe a schema, by its type.
_DESCRIBE_OF_TYPE = {
    "number": _allowed_number,
    "integer": _allowed_number,
    "string": _allowed_text,
    "array": _allowed_list,
    "object": _allowed_group,
}
_WORDS_OF_TYPE = {"boolean": "true, false", "null": "nothing"}
