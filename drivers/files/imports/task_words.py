"""What a task file of ISO 11783-10 holds, a line each: tasks, fields, products, devices, time logs."""
from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

from control.recordings.finding import many
from drivers.files.imports.devices import DeviceElement, width_m
from drivers.files.imports.task_log import log_lines, task_logs
from drivers.files.imports.trouble import listed

ORIGINS = {"1": "written before the work, by farm software", "2": "written after it, by a task controller"}


def task_words(path: Path, inside: str | None = None) -> list[str] | None:
    """None: no task file there. Raises Refused, OSError."""
    found = task_logs(path, inside)
    if found is None:
        return None
    root = found.root
    origin = ORIGINS.get(root.get("DataTransferOrigin", ""), "origin not given")
    lines = [f"{path}: task file, version {root.get('VersionMajor', '?')}.{root.get('VersionMinor', '?')}, {origin}"]
    for task in root.findall("TSK"):
        lines.append(f"{path}: {_task(root, task)}")
    for field in root.findall("PFD"):
        area = field.get("D", "")
        lines.append(f"{path}: field {_named(field, 'C')}" + (f", {int(area) / 10_000:.4f} ha as it says"
                                                              if area.isdigit() and int(area) else ""))
    for product in root.findall("PDT"):
        lines.append(f"{path}: product {_named(product, 'B')}")
    for device in root.findall("DVC"):
        lines.append(f"{path}: {_device(device, found.parts)}")
    return [*lines, *(f"{path}: {line}" for line in log_lines(found))]


def _named(element: Element, attribute: str) -> str:
    name = element.get(attribute, "")
    return element.get("A", "") + (f" ({name})" if name else "")


def _task(root: Element, task: Element) -> str:
    held = [many(len(task.findall(tag)), what) for tag, what in (
        ("TZN", "treatment zone"), ("GRD", "grid"), ("TLG", "time log")) if task.find(tag) is not None]
    field = next((_named(one, "C") for one in root.findall("PFD") if one.get("A") == task.get("E")), "")
    return f"task {_named(task, 'B')}: {listed(held) or 'nothing planned and nothing logged'}" + (
        f"; field {field}" if field else "")


def _device(device: Element, parts: dict[str, DeviceElement]) -> str:
    width = width_m(parts, device.get("A"))
    own = [part for part in parts.values() if part.device == device.get("A")]
    sections = sum(part.kind == "4" for part in own)
    words = [f"{width:g} m wide" if width is not None else "width not given"]
    words += [many(sections, "section")] if sections else []
    return f"device {_named(device, 'B')}: {', '.join(words)}; elements " \
        f"{listed(f'{part.id} {part.name}'.strip() for part in own)}"
