"""With which software, machine, crop, job and files was a run made? NAME.yaml next to a run log
states it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel
from topdress.drivers.files.atomic_files import find_sidecar
from topdress.drivers.files.plain_data import convert_to_plain
from topdress.drivers.files.yaml_text import YamlError, dump_yaml, parse_yaml

# Format of the sidecar, a contract.
RUN_LOG_FORMAT = "topdress-run-log/1"

PlainConfig = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class RunMeta:
    """Describes a run; unknown parts are None or empty. `machine`, `crop` and `job` are plain data
    with all defaults filled in."""

    software: str = ""
    machine: PlainConfig | None = None
    crop: PlainConfig | None = None
    job: PlainConfig | None = None
    # None means that the run was not simulated.
    seed: int | None = None
    # Checksums by the name of the configuration file.
    sha256: Mapping[str, str] = field(default_factory=dict)
    # ISO 8601 with the zone Z.
    started_utc: str | None = None
    # Further entries of the program that wrote the log.
    extra: Mapping[str, Any] = field(default_factory=dict)


def make_run_meta(
    machine: BaseModel | PlainConfig | None = None,
    crop: BaseModel | PlainConfig | None = None,
    job: BaseModel | PlainConfig | None = None,
    *,
    seed: int | None = None,
    sha256: Mapping[str, str] | None = None,
    started_utc: str | None = None,
    extra: Mapping[str, Any] | None = None,
) -> RunMeta:
    """Returns a `RunMeta` of this software, from configuration models or plain data."""
    return RunMeta(
        software=f"topdress {find_software_version()}",
        machine=_convert_optional(machine),
        crop=_convert_optional(crop),
        job=_convert_optional(job),
        seed=seed,
        sha256=dict(sha256 or {}),
        started_utc=started_utc,
        extra=dict(extra or {}),
    )


def find_software_version() -> str:
    """Returns name and version of the software."""
    try:
        return version("topdress")
    except PackageNotFoundError:
        return "unknown"


def format_meta_yaml(meta: RunMeta) -> str:
    """Returns the text of the sidecar."""
    return dump_yaml(
        {
            "format": RUN_LOG_FORMAT,
            "software": meta.software,
            "started_utc": meta.started_utc,
            "seed": meta.seed,
            "sha256": dict(meta.sha256),
            "machine": meta.machine,
            "crop": meta.crop,
            "job": meta.job,
            **meta.extra,
        }
    )


def parse_meta_yaml(text: str) -> RunMeta:
    """Returns the description of a run. Raises ValueError, in a line, for a text that does not
    describe a run log."""
    try:
        data, _ = parse_yaml(text)
    except (YamlError, yaml.YAMLError) as problem:
        raise ValueError(f"not readable: {problem}") from None
    if not isinstance(data, dict) or data.get("format") != RUN_LOG_FORMAT:
        found = data.get("format") if isinstance(data, dict) else None
        raise ValueError(f"key format: value {found}: allowed {RUN_LOG_FORMAT}")
    seed, checksums = data.get("seed"), data.get("sha256")
    known = {"format", "software", "machine", "crop", "job", "seed", "sha256", "started_utc"}
    return RunMeta(
        software=str(data.get("software") or ""),
        machine=_take_mapping(data.get("machine")),
        crop=_take_mapping(data.get("crop")),
        job=_take_mapping(data.get("job")),
        seed=seed if isinstance(seed, int) else None,
        sha256={str(k): str(v) for k, v in checksums.items()}
        if isinstance(checksums, dict)
        else {},
        started_utc=str(data["started_utc"]) if data.get("started_utc") else None,
        extra={k: v for k, v in data.items() if k not in known},
    )


def read_sidecar_meta(log: str | Path) -> RunMeta | None:
    """Returns the description next to a log; None without a readable description."""
    try:
        return parse_meta_yaml(find_sidecar(Path(log)).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _convert_optional(value: BaseModel | PlainConfig | None) -> PlainConfig | None:
    return None if value is None else dict(convert_to_plain(value))


def _take_mapping(value: object) -> PlainConfig | None:
    return value if isinstance(value, dict) else None
