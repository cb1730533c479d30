"""Which files come from other machines and programs, and how does one become a run log in the
user's own folder?
"""

from __future__ import annotations

from pathlib import Path

from topdress.console.app.pages.diagnosis.service import ImportNeedsAnswersError
from topdress.drivers.files.atomic_files import find_free_path
from topdress.drivers.files.file_sniffer import FOREIGN_SUFFIXES, TABLE_SUFFIXES

READ_SUFFIXES = TABLE_SUFFIXES | FOREIGN_SUFFIXES
# Suffixes of files that are listed; the removed suffixes often belong to other contents.
LISTED_SUFFIXES = READ_SUFFIXES - {".txt", ".log", ".dat", ".json", ".xml", ".zip"}
TASK_FILE_NAME, TASK_FOLDER_NAME = "taskdata.xml", "taskdata"
IMPORT_FILE_SUFFIX = ".import.yaml"
YAML_SUFFIXES = (".yaml", ".yml")


def is_likely_log(path: Path) -> bool:
    """Returns whether a file is probably a log, a table or an import file, by its name, or for
    folders and zips by the content."""
    name = path.name.lower()
    return (
        not name.startswith(".")
        and not name.endswith(".truth.csv")
        and (
            path.suffix.lower() in LISTED_SUFFIXES
            or name == TASK_FILE_NAME
            or name.endswith(IMPORT_FILE_SUFFIX)
            or _has_time_log(path)
        )
    )


def _has_time_log(path: Path) -> bool:
    """Returns whether a folder or a zip contains the log of a task that was worked."""
    from topdress.drivers.files.archives import has_time_log, open_archive
    from topdress.drivers.plain_text import RefusedInput

    if (
        not (path.suffix.lower() == ".zip" or path.name.lower() == TASK_FOLDER_NAME)
        or not path.exists()
    ):
        return False
    try:
        return has_time_log(open_archive(path))
    except (RefusedInput, OSError):
        return False


def is_importable(path: Path) -> bool:
    """Returns whether `import_file_as_log` accepts the path: a data file with a readable suffix, a
    folder with an ISO 11783 task, or an import file (the YAML that assigns columns)."""
    if path.is_dir():
        return any(file.name.lower() == TASK_FILE_NAME for file in path.iterdir())
    return path.suffix.lower() in READ_SUFFIXES or _is_import_file(path)


def import_file_as_log(path: Path, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """Writes the file at `path` (or the file of the import file at `path`) as a new run log in
    `folder`; returns its path, and notes on odd data.

    The import file next to it is used, else a guess in which nothing is unsure. Raises
    OpenQuestions for an unsure guess, after writing the guess next to the file; LogImportError,
    ConfigError and OSError.
    """
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.imports.convert import convert_table
    from topdress.drivers.files.imports.guess import guess_import_file
    from topdress.drivers.files.imports.guess_result import format_first_import
    from topdress.drivers.files.imports.log_file import write_imported_log
    from topdress.drivers.files.imports.log_join import join_files
    from topdress.drivers.files.imports.mapping import IMPORT_KIND
    from topdress.drivers.files.imports.table_reader import read_raw_table

    data, place = _find_import_pair(path)
    raw = read_raw_table(data)
    found = guess_import_file(raw)
    mapping, mapping_file = found.mapping, place if place.exists() else None
    first = format_first_import(found, [data], place)
    if not found.is_sure and (mapping_file is None or place.read_text(encoding="utf-8") == first):
        if not place.exists():
            write_atomically(place, first)
        raise ImportNeedsAnswersError(found.questions, str(place))
    if mapping_file is not None:
        mapping = load_config(mapping_file, IMPORT_KIND).model
        raw = read_raw_table(data, mapping.source)
    log = join_files([convert_table(raw, mapping)], mapping.join)
    out = find_free_path(folder, data.stem, ".csv", ".yaml")
    write_imported_log(out, log, mapping, mapping_file)
    return out, tuple(
        map(str, (*(one for part in log.parts for one in part.findings), *log.findings))
    )


def _is_import_file(path: Path) -> bool:
    from topdress.drivers.files.imports.mapping import IMPORT_KIND

    if path.suffix.lower() not in YAML_SUFFIXES:
        return False
    text = path.read_text(encoding="utf-8", errors="replace")
    return any(
        line.split("#")[0].split() == ["format:", IMPORT_KIND.format] for line in text.splitlines()
    )


def _find_import_pair(path: Path) -> tuple[Path, Path]:
    """Returns a file and its import file, given either of them: both have the same folder
    and stem."""
    if path.suffix.lower() not in YAML_SUFFIXES:
        return path, path.with_name(f"{path.stem}{IMPORT_FILE_SUFFIX}")
    stem = path.stem.removesuffix(Path(IMPORT_FILE_SUFFIX).stem)
    logs = sorted(
        file
        for file in path.parent.iterdir()
        if file.stem == stem and file.suffix.lower() in READ_SUFFIXES and file.is_file()
    )
    if len(logs) != 1:
        names = ", ".join(file.name for file in logs) or "none"
        raise ValueError(
            f"{path}: the file that it is for must stand next to it as {stem}.csv or alike; there: "
            f"{names}"
        )
    return logs[0], path
