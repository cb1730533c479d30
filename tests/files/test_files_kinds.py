from pathlib import Path

import pytest

from control.machine.machine import Machine
from drivers.files.config import load, load_any, save, schema, shipped
from drivers.files.kinds import KINDS, MACHINE

SHIPPED = [path for kind in KINDS.values() for path in shipped(kind.folder).values()]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_configuration_is_valid_and_survives_a_round_trip(path: Path, tmp_path: Path) -> None:
    kind, loaded = load_any(path, KINDS)
    assert path.parent.name == kind.folder
    save(tmp_path / path.name, loaded.model, kind)
    assert load(tmp_path / path.name, kind).model == loaded.model


def test_an_extended_machine_survives_a_round_trip(tmp_path: Path) -> None:
    machine = Machine()
    changed = machine.model_copy(update={"shaft": machine.shaft._replace(slow_s=0.1 + 0.2)})
    save(tmp_path / "m.yaml", changed, MACHINE)
    assert load(tmp_path / "m.yaml", MACHINE).model == changed


@pytest.mark.parametrize("format", KINDS)
def test_every_kind_has_a_schema_for_editors(format: str) -> None:
    body = schema(KINDS[format])
    assert body["properties"]["format"]["const"] == format
    assert "format" in body["required"]
