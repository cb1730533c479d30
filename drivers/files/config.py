"""How is a configuration file read? YAML becomes a pydantic model, or every error a plain line.

    huanghai.yaml: key flow.gain_percent: value 700: allowed -50 to 100 (line 12)

The module knows no particular model: `drivers.files.config_kinds` lists topdress's own.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ValidationError
from topdress.drivers.files.atomic_files import write_atomically
from topdress.drivers.files.config_error import ConfigError as ConfigError
from topdress.drivers.files.config_words import explain_errors, suggest_nearest
from topdress.drivers.files.limits import CONFIG_LIMIT
from topdress.drivers.files.plain_data import convert_to_plain, make_model_schema
from topdress.drivers.files.yaml_text import KeyPath, YamlError, dump_yaml, parse_yaml

M = TypeVar("M", bound=BaseModel)
Model = TypeVar("Model", bound=BaseModel, covariant=True)


@dataclass(frozen=True, slots=True)
class ConfigKind(Generic[Model]):
    """Describes a kind of configuration file: its `format:` field, the folder under configs/ with
    the shipped files, and its model."""

    format: str
    folder: str
    model: type[Model]
    # Converts an older file's data to the present form.
    of_today: Callable[[dict[str, Any]], dict[str, Any]] = dict


@dataclass(frozen=True, slots=True)
class LoadedConfig(Generic[Model]):
    """Holds a configuration as read; `sha256` is the checksum of exactly the bytes that
    were read."""

    model: Model
    path: Path
    sha256: str


ConfigKinds = Mapping[str, ConfigKind[BaseModel]]


def load_config(
    where: str | Path, kind: ConfigKind[M], base: Path | None = None
) -> LoadedConfig[M]:
    """Returns a configuration file of a given kind.

    Parameters
    ----------
    where : a path (relative to the folder `base`, else to the working folder) or the name of a
    shipped file.
    kind : the kind that the file must have.
    base : folder of relative paths.

    Returns
    -------
    model, path and checksum.

    Raises
    ------
    ConfigError : a line for each error.
    """
    path = resolve_config_path(where, [kind.folder], base)
    # The checksum is computed from the same bytes that are parsed, even if the file changes later.
    data, lines, sha256 = _read_config(path)
    return LoadedConfig(_validate_data(data, kind, str(path), lines), path, sha256)


def load_any_config(
    where: str | Path, kinds: ConfigKinds
) -> tuple[ConfigKind[BaseModel], LoadedConfig[BaseModel]]:
    """Returns a file of any registered kind, recognised by its `format:` field. Raises
    ConfigError."""
    path = resolve_config_path(where, [kind.folder for kind in kinds.values()])
    data, lines, sha256 = _read_config(path)
    label = str(path)
    # The message lists all formats, because a typing error is the usual reason.
    allowed = ", ".join(kinds)
    found = data.get("format")
    if found is None:
        raise ConfigError([f"{label}: key format: missing: allowed {allowed}"])
    if not isinstance(found, str) or found not in kinds:
        raise ConfigError(
            [
                f"{label}: key format: value {found}: allowed "
                f"{allowed}{suggest_nearest(str(found), kinds)} "
                f"(line {lines[('format',)]})"
            ]
        )
    kind = kinds[found]
    return kind, LoadedConfig(_validate_data(data, kind, label, lines), path, sha256)


def validate_config(data: Mapping[str, Any], kind: ConfigKind[M], label: str) -> M:
    """Returns a model from plain data, such as the machine in a run log's sidecar; `label` replaces
    the file's name in messages. Raises ConfigError."""
    return _validate_data(dict(data), kind, label, {})


def save_config(path: Path, model: BaseModel, kind: ConfigKind[Any], comment: str = "") -> None:
    """Writes a configuration that `load_config` reads back to an equal model, completely or not at
    all. Raises OSError."""
    # The format comes first, so that a reader recognises the file.
    data = {"format": kind.format} | convert_to_plain(model)
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_atomically(path, head + dump_yaml(data))


def make_json_schema(kind: ConfigKind[Any]) -> dict[str, Any]:
    """Returns the JSON schema (2020-12) of a kind, with its `format` field, for editors."""
    body = make_model_schema(kind.model)
    properties = {"format": {"const": kind.format}} | {
        # The format is fixed by the kind, not by the model.
        k: v
        for k, v in body.get("properties", {}).items()
        if k != "format"
    }
    required = ["format", *(k for k in body.get("required", []) if k != "format")]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **body,
        "properties": properties,
        "required": required,
    }


def calc_sha256(path: Path) -> str:
    """Returns the checksum of a file's bytes, in hexadecimal. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def find_shipped_files(folder: str) -> dict[str, Path]:
    """Returns the paths of the shipped configurations in a folder, such as `machines`, by name."""
    place = Path(str(resources.files("topdress.configs"))) / folder
    return {path.stem: path for path in sorted(place.glob("*.yaml"))}


def resolve_config_path(
    where: str | Path, folders: Iterable[str], base: Path | None = None
) -> Path:
    """Returns the path of a path or of a shipped name (without folder and .yaml). Raises
    ConfigError."""
    text = str(where)
    # A name without folder and suffix is a shipped file; everything else is a path.
    if (
        isinstance(where, Path)
        or "/" in text
        or "\\" in text
        or text.lower().endswith((".yaml", ".yml"))
    ):
        path = Path(where)
        return base / path if base is not None else path
    names = {name: path for folder in folders for name, path in find_shipped_files(folder).items()}
    # A file with this name in the working folder was probably meant, so the message says how to
    # name it.
    if text not in names and Path(text).exists():
        raise ConfigError(
            [
                f"{text}: is there, but no configuration: allowed is a .yaml file (topdress "
                "map tells what "
                "a prescription holds, topdress import what a log does)"
            ]
        )
    if text not in names:
        raise ConfigError(
            [
                f"{text}: no configuration of this name is shipped: allowed "
                f"{', '.join(names) or 'none'}, "
                f"or the path of a .yaml file{suggest_nearest(text, names)}"
            ]
        )
    return names[text]


def _read_config(path: Path) -> tuple[dict[str, Any], dict[KeyPath, int], str]:
    """Returns a file's data, the line of each key, and the checksum. Raises ConfigError."""
    label = str(path)
    try:
        with path.open("rb") as file:
            # One byte more shows that the file is too large.
            raw = file.read(CONFIG_LIMIT.most + 1)
    except FileNotFoundError:
        raise ConfigError([f"{label}: no such file"]) from None
    except OSError as error:
        raise ConfigError([f"{label}: cannot be read: {error.strerror or error}"]) from None
    if len(raw) > CONFIG_LIMIT.most:
        raise ConfigError(
            [f"{label}: too large for a configuration: allowed {CONFIG_LIMIT.most} bytes"]
        )
    try:
        # Editors on Windows add a byte order mark.
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError([f"{label}: byte {error.start + 1}: not UTF-8 text"]) from None
    try:
        data, lines = parse_yaml(text)
        # The test finds values that JSON cannot express before the validation uses JSON.
        json.dumps(data)
    except (YamlError, TypeError) as problem:
        raise ConfigError([f"{label}: {problem}"]) from None
    if not isinstance(data, dict):
        what = "the file is empty" if data is None else f"found {type(data).__name__}"
        raise ConfigError([f"{label}: {what}: a configuration is made of lines `key: value`"])
    return data, lines, hashlib.sha256(raw).hexdigest()


def _validate_data(
    data: dict[str, Any], kind: ConfigKind[M], label: str, lines: Mapping[KeyPath, int]
) -> M:
    """Returns the model of a file's data. Raises ConfigError."""
    found = data.get("format")
    if found is None:
        raise ConfigError([f"{label}: key format: missing: allowed {kind.format}"])
    if found != kind.format:
        at = f" (line {lines[('format',)]})" if ("format",) in lines else ""
        raise ConfigError([f"{label}: key format: value {found}: allowed {kind.format}{at}"])
    # Older files are converted first, so that errors refer to present keys.
    data = kind.of_today(data)
    if "format" not in kind.model.model_fields:
        data = {k: v for k, v in data.items() if k != "format"}
    try:
        # The JSON mode of pydantic is strict: it never reads a number from a text or from true, but
        # it accepts lists, dates and choices.
        return kind.model.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        raise ConfigError(explain_errors(error, kind.model, data, label, lines)) from None
