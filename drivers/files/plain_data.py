"""How do models become plain data and JSON schema, and how are they read back? NamedTuples become
objects by name; pydantic alone would make lists.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import PurePath
from typing import Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema


def convert_to_plain(value: Any) -> Any:
    """Returns models, NamedTuples, data classes, arrays, enums, dates and paths as mappings, lists,
    texts and numbers. Raises TypeError for other values."""
    if isinstance(value, BaseModel):
        return {
            info.alias or name: convert_to_plain(getattr(value, name))
            for name, info in type(value).model_fields.items()
        }
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return {name: convert_to_plain(part) for name, part in value._asdict().items()}
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: convert_to_plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(convert_to_plain(key)): convert_to_plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [convert_to_plain(part) for part in value]
    if isinstance(value, Enum) or hasattr(value, "tolist"):
        return convert_to_plain(value.value if isinstance(value, Enum) else value.tolist())
    if isinstance(value, dt.date | dt.time):
        return value.isoformat()
    if isinstance(value, PurePath):
        return value.as_posix()
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise TypeError(f"{type(value).__name__} has no place in a configuration file")


T = TypeVar("T")


def build_from_plain(kind: type[T], data: Any) -> T:
    """Returns a data class or NamedTuple, with all nested ones, from the data of its JSON. Unknown
    keys are ignored, so that an older program reads a newer program's files. Raises ValueError, in
    a line, where a value does not fit."""
    hashable: Any = kind
    try:
        made: T = _make_adapter(hashable).validate_python(data)
        return made
    except ValidationError as error:
        unknown = [one["loc"] for one in error.errors() if one["type"] == "extra_forbidden"]
        if not unknown:
            first = error.errors()[0]
            raise ValueError(
                f"{'.'.join(map(str, first['loc'])) or kind.__name__}: {first['msg']}"
            ) from None
    return build_from_plain(kind, _drop_keys(data, unknown))


def _drop_keys(data: Any, unknown: list[tuple[int | str, ...]]) -> Any:
    """Returns a copy without the keys at these places."""
    here = {place[0] for place in unknown if len(place) == 1}
    items = data.items() if isinstance(data, Mapping) else enumerate(data)
    kept = {
        name: _drop_keys(part, deeper)
        if (deeper := [place[1:] for place in unknown if place[0] == name and len(place) > 1])
        else part
        for name, part in items
        if name not in here
    }
    return kept if isinstance(data, Mapping) else list(kept.values())


@cache
def _make_adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


class _SchemaByName(GenerateJsonSchema):
    """Makes schemas of NamedTuples, and of their defaults, as objects with properties."""

    def named_tuple_schema(self, schema: Any) -> JsonSchemaValue:
        fields = {field["name"]: field["schema"] for field in schema["fields"]}
        json_schema: JsonSchemaValue = {
            "type": "object",
            "properties": {name: self.generate_inner(inner) for name, inner in fields.items()},
            "additionalProperties": False,
        }
        required = [name for name, inner in fields.items() if inner["type"] != "default"]
        return json_schema | {"required": required} if required else json_schema

    def arguments_schema(self, schema: core_schema.ArgumentsSchema) -> JsonSchemaValue:
        """Returns the schema for pydantic before 2.13, which treats a NamedTuple as a call with
        arguments."""
        return self.kw_arguments_schema(schema["arguments_schema"], schema.get("var_kwargs_schema"))

    def encode_default(self, dft: Any) -> Any:
        return convert_to_plain(dft)


def make_model_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Returns the JSON schema of a model's files."""
    return model.model_json_schema(by_alias=True, schema_generator=_SchemaByName)
