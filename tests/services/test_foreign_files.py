"""Logs of other machines on the Diagnosis page: listed, brought in where that is certain, else
asked about."""

from __future__ import annotations

import shutil
from pathlib import Path

import polars as pl
import pytest
from topdress.console.app.pages.diagnosis.service import (
    IMPORT_KIND,
    ImportNeedsAnswersError,
    StopSignal,
)
from topdress.console.services.diagnosis import DiagnosisFiles
from topdress.console.services.foreign_files import import_file_as_log, is_likely_log
from topdress.drivers.plain_text import RefusedInput

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "import"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    here = tmp_path / "data"
    here.mkdir()
    for name in ("planter.csv", "tractor.csv", "applied.geojson"):
        shutil.copy(EXAMPLES / name, here / name)
    (here / "shopping.csv").write_text("eggs,milk\n6,1\n", encoding="utf-8")
    (here / "notes.txt").write_text("eggs\n", encoding="utf-8")
    return here


def test_files_that_may_be_logs_are_listed_as_such(folder: Path, tmp_path: Path) -> None:
    (folder / "planter.import.yaml").write_text("format: topdress-import/1\n", encoding="utf-8")
    found = DiagnosisFiles([folder], own=tmp_path / "own").list_sources("")
    assert {one.name: one.kind for one in found} == dict.fromkeys(
        ("planter.csv", "tractor.csv", "applied.geojson", "shopping.csv", "planter.import.yaml"),
        IMPORT_KIND,
    )
    assert not is_likely_log(Path("run.truth.csv")) and not is_likely_log(Path("machine.yaml"))
    assert is_likely_log(Path("TASKDATA.XML"))


def test_what_is_certain_becomes_a_new_log_each_time(folder: Path, tmp_path: Path) -> None:
    logs = tmp_path / "own" / "logs"
    paths = [import_file_as_log(folder / "tractor.csv", logs)[0] for _twice in (1, 2)]
    assert [path.name for path in paths] == ["tractor.csv", "tractor-2.csv"]
    assert all(path.with_suffix(".yaml").exists() for path in paths)
    assert pl.read_csv(paths[0]).height == 400
    assert "65535" in " ".join(import_file_as_log(folder / "tractor.csv", logs)[1])
    assert sorted(file.name for file in folder.glob("*.yaml")) == []


def test_open_questions_are_asked_until_the_import_file_is_edited(
    folder: Path, tmp_path: Path
) -> None:
    logs, place = tmp_path / "logs", folder / "planter.import.yaml"
    for picked in (folder / "planter.csv", folder / "planter.csv", place):
        with pytest.raises(ImportNeedsAnswersError) as asked:
            import_file_as_log(picked, logs)
        assert (
            asked.value.import_file == str(place)
            and "what 100 % is in mm" in asked.value.questions[0]
        )
        assert not logs.exists()
    text = (
        place.read_text(encoding="utf-8")
        .replace("full: }", "full: 60}")
        .replace("  # opening_mm:", "  opening_mm:")
    )
    place.write_text(text, encoding="utf-8")
    for picked, name in ((folder / "planter.csv", "planter.csv"), (place, "planter-2.csv")):
        log, notes = import_file_as_log(picked, logs)
        assert log.name == name and pl.read_csv(log)["opening_mm"].max() > 10.0
        assert any("-9999" in note for note in notes)
    assert place.read_text(encoding="utf-8") == text


def test_an_import_file_without_its_file_is_refused(folder: Path, tmp_path: Path) -> None:
    alone = folder / "gone.import.yaml"
    alone.write_text("format: topdress-import/1\n", encoding="utf-8")
    with pytest.raises(
        ValueError, match=r"must stand next to it as gone\.csv or alike; there: none"
    ):
        import_file_as_log(alone, tmp_path)
    (folder / "broken.parquet").write_bytes(b"no table")
    with pytest.raises(RefusedInput, match="not readable as Parquet"):
        import_file_as_log(folder / "broken.parquet", tmp_path / "logs")
    assert not (folder / "broken.import.yaml").exists() and not (tmp_path / "logs").exists()


@pytest.mark.exam
def test_the_page_diagnoses_a_foreign_file_by_its_process(folder: Path, tmp_path: Path) -> None:
    service, told = DiagnosisFiles([folder], own=tmp_path / "own"), []
    source = service.find_source(str(folder / "tractor.csv"))
    found = service.run_diagnosis(
        source, None, lambda share, stage: told.append(stage), StopSignal()
    )
    assert (
        source.kind == IMPORT_KIND and found.source == "tractor.csv" and found.found.data.rows > 100
    )
    assert (
        Path(found.found.data.path) == tmp_path / "own" / "logs" / "tractor.csv"
        and "importing" in told
    )
    assert any("65535" in note for note in found.found.findings)
    with pytest.raises(ImportNeedsAnswersError, match="opening_mm"):
        service.run_diagnosis(
            service.find_source(str(folder / "planter.csv")), None, lambda *_: None, StopSignal()
        )
    (folder / "broken.parquet").write_bytes(b"no table")
    with pytest.raises(ValueError, match="not readable as Parquet") as caught:
        service.run_diagnosis(
            service.find_source(str(folder / "broken.parquet")), None, lambda *_: None, StopSignal()
        )
    assert "\n" not in str(caught.value) and "Traceback" not in str(caught.value)
