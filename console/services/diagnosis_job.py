"""The Diagnosis page's heavy work as a process of its own: `python -m
console.services.diagnosis_job FILE.json`.

The file says what is to be done (`Order` below). While it works it writes {"share": 0.3,
"stage": "flow"} lines on stdout, and at last {"done": true}, {"error": "one line"} or
{"questions": [...], "import_file": "path"}. In the folder then lie view.json, result.json,
report.html, and a machine file for each choice of what is adopted. Ending the process cancels.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topdress.console.app.pages.diagnosis.service import IMPORT, AdoptionOffer, OpenQuestions
from topdress.drivers import day_clock

if TYPE_CHECKING:
    from topdress.control.diagnosis.result import Diagnosis
    from topdress.control.machine.machine import Machine

Tell = Callable[[float, str], None]

VIEW, RESULT, REPORT = "view.json", "result.json", "report.html"
RUN_LOG = "separating.csv"
DRIVING = 0.55  # share of the whole that simulating takes
LEAST_STEP = 0.004  # of the share, that is worth a line
NICE = 10  # the control loop comes first


@dataclasses.dataclass(frozen=True, slots=True)
class DiagnosisOrder:
    """machine None: the one that the log names, else `default_machine`. manoeuvre: drive this
    run first and diagnose its log instead of `data`. planted: effects of the machine that
    drives it (grammar of `simulate --effect`). logs: folder of the log that data of kind import
    becomes first. compare: `machine` as it was before its last change and as it is, held
    against the log."""

    data: str
    folder: str
    kind: str = "run"
    machine: str | None = None
    default_machine: str = "huanghai"
    manoeuvre: str = ""
    planted: tuple[str, ...] = ()
    seed: int = 1
    logs: str = ""
    compare: bool = False


def work(order: DiagnosisOrder, tell: Tell) -> None:
    """Everything; raises ValueError, OSError or a ConfigError of one line."""
    if order.compare:
        compared_before_and_after(order, tell)
        return
    notes: tuple[str, ...] = ()
    if order.kind == IMPORT:
        from topdress.console.services.foreign_files import brought_in

        tell(0.0, "importing")
        log, notes = brought_in(Path(order.data), Path(order.logs))
        order = dataclasses.replace(order, data=str(log), kind="run")
    machine = machine_of(order)
    data, name, done = Path(order.data), Path(order.data).name, 0.0
    if order.manoeuvre:
        data = Path(order.folder) / RUN_LOG
        name, done = data.name, DRIVING
        drive(order, machine, data, lambda share, stage: tell(DRIVING * share, stage))

    def later(share: float, stage: str) -> None:
        tell(done + (1.0 - done) * share, stage)

    _diagnosed(order, machine, data, name, notes, later)


def compared_before_and_after(order: DiagnosisOrder, tell: Tell) -> None:
    """Errors of a machine file on a log before and after its last change, in words and as a
    page."""
    from topdress.console.reports.compare_page import compare_page, plain
    from topdress.control.diagnosis.runs.compared import compared
    from topdress.control.machine.history import undone
    from topdress.drivers.files.any_log import open_log
    from topdress.drivers.files.atomic import write_atomically

    after = machine_of(order)
    tell(0.0, "reading")
    found = compared(
        dict(open_log(Path(order.data)).columns),
        undone(after),
        after,
        lambda share, word: tell(0.8 * share, word),
    )
    logs, old = [(order.data, found)], f"{order.machine}, before its last change"
    tell(0.85, "report")
    write_atomically(Path(order.folder) / RESULT, json.dumps(plain(logs)))
    write_atomically(Path(order.folder) / REPORT, compare_page(logs, old, str(order.machine)))


def machine_of(order: DiagnosisOrder) -> Machine:
    """The machine that the data is held against."""
    from topdress.console.services.live_check import machine_of_log

    return machine_of_log(Path(order.data), order.machine, order.default_machine)


def drive(order: DiagnosisOrder, machine: Machine, out: Path, tell: Tell) -> None:
    """The separating run on the simulated machine, as an ordinary run log."""
    from topdress.console.services.separating_run import make_drive
    from topdress.control.machine.fault_injection import parse_planted
    from topdress.control.simulation.assembly import (
        control_loop,
        simulated_machine,
        with_simulated_field,
    )
    from topdress.control.simulation.closed_loop import simulated_run
    from topdress.drivers.files.run_log import PlainLogWriter
    from topdress.drivers.files.run_meta import run_meta
    from topdress.drivers.files.setup import load_setup

    dt_s = 0.05
    setup = load_setup(order.default_machine, "demo", day_clock.today())
    wanted = make_drive(order.manoeuvre, setup.job, machine)
    job = with_simulated_field(wanted.job, machine)
    plant = simulated_machine(
        machine, job, order.seed, dt_s, [parse_planted(text) for text in order.planted]
    )
    loop = control_loop(machine, setup.crop, setup.rule, job)
    writer = PlainLogWriter(
        out, run_meta(machine, setup.crop, job, seed=order.seed), overwrite=True
    )
    try:
        for number, step in enumerate(
            simulated_run(plant, loop, wanted.seconds, orders=wanted.orders)
        ):
            writer.append(step.tick.row)
            if number % 200 == 0:
                tell(number * dt_s / wanted.seconds, "driving")
    finally:
        writer.close()


def _diagnosed(
    order: DiagnosisOrder,
    machine: Machine,
    data: Path,
    name: str,
    notes: tuple[str, ...],
    tell: Tell,
) -> None:
    """notes: of bringing the data in."""
    from topdress.console.app.pages.diagnosis.adoption import list_selections
    from topdress.console.services.diagnosis_view import found_of, mean_target
    from topdress.drivers.files.atomic import write_atomically
    from topdress.drivers.files.plain import plain

    folder = Path(order.folder)
    tell(0.0, "reading")
    target = None
    tools: dict[str, Any]
    if order.kind == "run":
        from topdress.control.diagnosis.runs.diagnose import diagnose_run
        from topdress.drivers.files.any_log import open_log

        log = open_log(data)
        columns = dict(log.columns)
        found = diagnose_run(
            columns, machine, path=str(data), progress=lambda share, word: tell(0.85 * share, word)
        )
        said = dict.fromkeys((*notes, *map(str, log.findings), *found.findings))
        found = dataclasses.replace(found, findings=tuple(said))
        tools, target = {"columns": columns, "machine": machine}, mean_target(columns)
    else:
        from topdress.control.diagnosis.tables.diagnose import diagnose_tables
        from topdress.drivers.files.bench_table import read_bench_table

        tables = [read_bench_table(data, order.kind)]
        found = diagnose_tables(
            tables, machine, progress=lambda share, word: tell(0.85 * share, word)
        )
        tools = {"tables": tables, "machine": machine}
    tell(0.86, "pictures")
    view = found_of(found, tools, name, target, order.planted)
    offers = []
    for number, ids in enumerate(list_selections(view)):
        file = f"machine-{number}.yaml"
        offers.append(_offer(found, ids, machine, data, folder / file))
    write_atomically(folder / RESULT, json.dumps(found.to_json(), indent=1) + "\n")
    write_atomically(folder / VIEW, json.dumps(plain(view._replace(offers=tuple(offers)))))
    tell(0.9, "report")
    _report(found, tools, folder / REPORT)


def _report(found: Diagnosis, tools: dict[str, Any], path: Path) -> None:
    """Writes the page with pictures."""
    from topdress.console.reports.diagnosis_html import diagnosis_page
    from topdress.drivers.files.atomic import write_atomically

    with_date = tools | {"date": day_clock.today().isoformat()}
    write_atomically(path, diagnosis_page(found, with_date))


def _offer(
    found: Diagnosis, ids: tuple[str, ...], machine: Machine, data: Path, path: Path
) -> AdoptionOffer:
    """The machine file with what may be adopted, for the page to put in its place when the
    operator says so; and what changed in it, a line each."""
    from topdress.console.reports.diagnosis_wording import format_whole_id
    from topdress.console.reports.term_words import compare_side_by_side
    from topdress.control.diagnosis.extend import extend
    from topdress.control.diagnosis.runs.adoption import select_adoptable
    from topdress.drivers.files.config import save, sha256_of
    from topdress.drivers.files.kinds import MACHINE

    fitted = (
        found.fitted if found.fitted is not None and format_whole_id(found.fitted) in ids else None
    )
    terms = tuple(one for one in found.terms if one.term["id"] in ids)
    taken = select_adoptable(dataclasses.replace(found, fitted=fitted, terms=terms), ids)
    refused = tuple(f"{name}: {why}" for name, why in taken.refused)
    extended = extend(
        machine, taken.found, date=day_clock.today().isoformat(), sha256=sha256_of(data)
    )
    if extended == machine:
        return AdoptionOffer(ids, "", (), refused)
    left = {name for name, _ in taken.refused}
    comment = "\n".join(
        [
            f"Extended by a diagnosis of {data.name}, verdict {found.verdict}:",
            *(f"  {one}" for one in ids if one not in left),
        ]
    )
    save(path, extended, MACHINE, comment)
    return AdoptionOffer(ids, path.name, tuple(compare_side_by_side(extended.history[-1])), refused)


def teller() -> Tell:
    """Progress lines on stdout, not more often than somebody can see."""
    last = -1.0

    def tell(share: float, stage: str) -> None:
        nonlocal last
        if share - last >= LEAST_STEP or share < last:
            last = share
            _say({"share": round(share, 3), "stage": stage})

    return tell


def _say(what: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main(path: str) -> int:
    from topdress.drivers.files.config import ConfigError
    from topdress.drivers.files.plain import typed

    if hasattr(os, "nice"):
        os.nice(NICE)
    try:
        said = json.loads(Path(path).read_text(encoding="utf-8"))
        work(typed(DiagnosisOrder, said), teller())
    except OpenQuestions as asked:
        _say({"questions": asked.questions, "import_file": asked.import_file})
    except ConfigError as error:
        _say({"error": error.lines[0]})
    except (ValueError, OSError) as error:
        _say({"error": (str(error).splitlines() or [type(error).__name__])[0]})
    else:
        _say({"done": True})
        return 0
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
