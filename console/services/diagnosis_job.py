"""How does the slow work of the Diagnosis page run as a process of its own, `python -m
console.services.diagnosis_job FILE.json`?

The file describes the work (`DiagnosisOrder`). While working, the process writes lines {"share":
0.3, "stage": "flow"} on stdout, and finally {"done": true}, {"error": "one line"} or {"questions":
[...], "import_file": "path"}. The folder then contains view.json, result.json, report.html, and a
machine file for each possible choice of effects to adopt. Ending the process cancels the work.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topdress.console.app.pages.diagnosis.service import (
    IMPORT_KIND,
    AdoptionOffer,
    ImportNeedsAnswersError,
)
from topdress.drivers import day_clock

# Type checking only: the process starts before it loads numpy and the diagnosis.
if TYPE_CHECKING:
    from topdress.control.diagnosis.result import Diagnosis
    from topdress.control.machine.machine import Machine

TellProgress = Callable[[float, str], None]

VIEW_NAME, RESULT_NAME, REPORT_NAME = "view.json", "result.json", "report.html"
RUN_LOG_NAME = "separating.csv"
# Share of the whole work that the simulation takes.
SIMULATION_SHARE_OF_WORK = 0.55
# Smallest change of the share that is reported.
MIN_REPORTED_PROGRESS_STEP = 0.004
# Nice value of the process, because the control loop comes first.
DIAGNOSIS_NICENESS = 10


@dataclasses.dataclass(frozen=True, slots=True)
class DiagnosisOrder:
    """Describes the work of one process.

    `machine` None means the machine that the log names, else `default_machine`. `manoeuvre` is
    driven first, and its log is diagnosed instead of `data`. `planted` are effects of the simulated
    machine (grammar of `simulate --effect`). `logs` is the folder of the log that data of kind
    import become first. `compare` compares `machine` before and after its last change on the log.
    """

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


def carry_out_order(order: DiagnosisOrder, tell: TellProgress) -> None:
    """Carries out the work of an order; raises ValueError, OSError or a ConfigError of one line."""
    if order.compare:
        compare_before_and_after(order, tell)
        return
    notes: tuple[str, ...] = ()
    if order.kind == IMPORT_KIND:
        from topdress.console.services.foreign_files import import_file_as_log

        # A progress line before the slow import shows that the process runs.
        tell(0.0, "importing")
        log, notes = import_file_as_log(Path(order.data), Path(order.logs))
        # The imported log is diagnosed as a run: from here on its origin makes no difference.
        order = dataclasses.replace(order, data=str(log), kind="run")
    machine = find_order_machine(order)
    data, name, done = Path(order.data), Path(order.data).name, 0.0
    if order.manoeuvre:
        data = Path(order.folder) / RUN_LOG_NAME
        name, done = data.name, SIMULATION_SHARE_OF_WORK
        drive_simulated_run(
            order, machine, data, lambda share, stage: tell(SIMULATION_SHARE_OF_WORK * share, stage)
        )

    def tell_later_share(share: float, stage: str) -> None:
        # The diagnosis fills the rest of the bar behind the simulated drive.
        tell(done + (1.0 - done) * share, stage)

    _diagnose_and_write(order, machine, data, name, notes, tell_later_share)


def compare_before_and_after(order: DiagnosisOrder, tell: TellProgress) -> None:
    """Writes the errors of a machine file on a log before and after its last change, in words and
    as a page."""
    from topdress.console.reports.compare_page import list_plain_data, make_compare_page
    from topdress.control.diagnosis.runs.compared import compared
    from topdress.control.machine.history import undo_last_change
    from topdress.drivers.files.any_log import open_any_log
    from topdress.drivers.files.atomic_files import write_atomically

    # The order's machine is the changed file; its own history gives the file before.
    after = find_order_machine(order)
    tell(0.0, "reading")
    found = compared(
        dict(open_any_log(Path(order.data)).columns),
        undo_last_change(after),
        after,
        # The comparison takes some 80 % of the time, and the pages take the rest.
        lambda share, word: tell(0.8 * share, word),
    )
    logs, old = [(order.data, found)], f"{order.machine}, before its last change"
    tell(0.85, "report")
    write_atomically(Path(order.folder) / RESULT_NAME, json.dumps(list_plain_data(logs)))
    write_atomically(
        Path(order.folder) / REPORT_NAME, make_compare_page(logs, old, str(order.machine))
    )


def find_order_machine(order: DiagnosisOrder) -> Machine:
    """Returns the machine with which the data are compared."""
    from topdress.console.services.live_check import load_log_machine

    return load_log_machine(Path(order.data), order.machine, order.default_machine)


def drive_simulated_run(
    order: DiagnosisOrder, machine: Machine, out: Path, tell: TellProgress
) -> None:
    """Drives the separating run on the simulated machine, as an ordinary run log."""
    from topdress.console.services.separating_run import make_drive
    from topdress.control.machine.fault_injection import parse_planted
    from topdress.control.simulation.assembly import (
        add_simulated_field,
        make_control_loop,
        make_plant,
    )
    from topdress.control.simulation.closed_loop import simulate_run
    from topdress.drivers.files.run_log import PlainLogWriter
    from topdress.drivers.files.run_meta import make_run_meta
    from topdress.drivers.files.run_setup import load_setup

    # Tick of the control loop, s.
    dt_s = 0.05
    setup = load_setup(order.default_machine, "demo", day_clock.read_today())
    wanted = make_drive(order.manoeuvre, setup.job, machine)
    # A job without a boundary gets the simulator's field.
    job = add_simulated_field(wanted.job, machine)
    plant = make_plant(
        machine, job, order.seed, dt_s, [parse_planted(text) for text in order.planted]
    )
    loop = make_control_loop(machine, setup.crop, setup.rule, job)
    writer = PlainLogWriter(
        # The folder belongs to this order alone, so an earlier file there may be replaced.
        out,
        make_run_meta(machine, setup.crop, job, seed=order.seed),
        overwrite=True,
    )
    try:
        for number, step in enumerate(
            simulate_run(plant, loop, wanted.seconds, orders=wanted.orders)
        ):
            writer.append(step.tick.row)
            # 200 ticks are 10 s of simulated time; more lines would only cost time.
            if number % 200 == 0:
                tell(number * dt_s / wanted.seconds, "driving")
    # The log is closed after a failure too, so that its rows reach the disk.
    finally:
        writer.close()


def _diagnose_and_write(
    order: DiagnosisOrder,
    machine: Machine,
    data: Path,
    name: str,
    notes: tuple[str, ...],
    tell: TellProgress,
) -> None:
    """Diagnoses the data and writes view, result and report. `notes` are those of the import."""
    from topdress.console.app.pages.diagnosis.adoption import list_selections
    from topdress.console.services.diagnosis_view import calc_mean_target, make_diagnosis_view
    from topdress.drivers.files.atomic_files import write_atomically
    from topdress.drivers.files.plain_data import convert_to_plain

    folder = Path(order.folder)
    tell(0.0, "reading")
    target = None
    tools: dict[str, Any]
    if order.kind == "run":
        from topdress.control.diagnosis.runs.diagnose import diagnose_run
        from topdress.drivers.files.any_log import open_any_log

        log = open_any_log(data)
        columns = dict(log.columns)
        found = diagnose_run(
            columns, machine, path=str(data), progress=lambda share, word: tell(0.85 * share, word)
        )
        # dict.fromkeys removes doubles: import and diagnosis can report the same fact.
        said = dict.fromkeys((*notes, *map(str, log.findings), *found.findings))
        found = dataclasses.replace(found, findings=tuple(said))
        tools, target = {"columns": columns, "machine": machine}, calc_mean_target(columns)
    else:
        from topdress.control.diagnosis.tables.diagnose import diagnose_tables
        from topdress.drivers.files.bench_table import read_bench_table

        tables = [read_bench_table(data, order.kind)]
        found = diagnose_tables(
            tables, machine, progress=lambda share, word: tell(0.85 * share, word)
        )
        tools = {"tables": tables, "machine": machine}
    tell(0.86, "pictures")
    view = make_diagnosis_view(found, tools, name, target, order.planted)
    # Machine files are written for all possible selections now, so that adopting one needs no
    # second diagnosis.
    offers = []
    for number, ids in enumerate(list_selections(view)):
        file = f"machine-{number}.yaml"
        offers.append(_write_adoption_offer(found, ids, machine, data, folder / file))
    # JSON is written before the report: a report that fails must not lose the result.
    write_atomically(folder / RESULT_NAME, json.dumps(found.to_json(), indent=1) + "\n")
    write_atomically(
        folder / VIEW_NAME, json.dumps(convert_to_plain(view._replace(offers=tuple(offers))))
    )
    tell(0.9, "report")
    _write_report(found, tools, folder / REPORT_NAME)


def _write_report(found: Diagnosis, tools: dict[str, Any], path: Path) -> None:
    """Writes the page with pictures."""
    from topdress.console.reports.diagnosis_html import make_diagnosis_page
    from topdress.drivers.files.atomic_files import write_atomically

    with_date = tools | {"date": day_clock.read_today().isoformat()}
    write_atomically(path, make_diagnosis_page(found, with_date))


def _write_adoption_offer(
    found: Diagnosis, ids: tuple[str, ...], machine: Machine, data: Path, path: Path
) -> AdoptionOffer:
    """Writes the machine file with the effects that may be adopted and returns it with its changes,
    one line each. The page puts the file in its place when the operator agrees."""
    from topdress.console.reports.diagnosis_wording import format_whole_id
    from topdress.console.reports.term_words import compare_side_by_side
    from topdress.control.diagnosis.extend import extend
    from topdress.control.diagnosis.runs.adoption import select_adoptable
    from topdress.drivers.files.config import calc_sha256, save_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    # The fit of several parameters of a drive at once is adopted only if the operator selected it.
    fitted = (
        found.fitted if found.fitted is not None and format_whole_id(found.fitted) in ids else None
    )
    terms = tuple(one for one in found.terms if one.term["id"] in ids)
    taken = select_adoptable(dataclasses.replace(found, fitted=fitted, terms=terms), ids)
    refused = tuple(f"{name}: {why}" for name, why in taken.refused)
    extended = extend(
        machine, taken.found, date=day_clock.read_today().isoformat(), sha256=calc_sha256(data)
    )
    # A file that equals the old one would be an empty entry of the history.
    if extended == machine:
        return AdoptionOffer(ids, "", (), refused)
    left = {name for name, _ in taken.refused}
    comment = "\n".join(
        [
            f"Extended by a diagnosis of {data.name}, verdict {found.verdict}:",
            *(f"  {one}" for one in ids if one not in left),
        ]
    )
    save_config(path, extended, MACHINE_KIND, comment)
    return AdoptionOffer(ids, path.name, tuple(compare_side_by_side(extended.history[-1])), refused)


def make_progress_teller() -> TellProgress:
    """Returns a function that prints progress lines on stdout, not more often than a person can
    see."""
    last = -1.0

    def tell_progress(share: float, stage: str) -> None:
        nonlocal last
        # A falling share is the beginning of a later stage and is shown at once.
        if share - last >= MIN_REPORTED_PROGRESS_STEP or share < last:
            last = share
            _print_json_line({"share": round(share, 3), "stage": stage})

    return tell_progress


def _print_json_line(what: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    # The page reads line by line; a buffered line would arrive only at the end.
    sys.stdout.flush()


def run_job(path: str) -> int:
    """Carries out the order in the file at `path`; returns the exit code."""
    from topdress.drivers.files.config import ConfigError
    from topdress.drivers.files.plain_data import build_from_plain

    # Windows has no nice values.
    if hasattr(os, "nice"):
        os.nice(DIAGNOSIS_NICENESS)
    try:
        said = json.loads(Path(path).read_text(encoding="utf-8"))
        carry_out_order(build_from_plain(DiagnosisOrder, said), make_progress_teller())
    # An import with open questions is no error: the page asks them.
    except ImportNeedsAnswersError as asked:
        _print_json_line({"questions": asked.questions, "import_file": asked.import_file})
    except ConfigError as error:
        _print_json_line({"error": error.lines[0]})
    except (ValueError, OSError) as error:
        _print_json_line({"error": (str(error).splitlines() or [type(error).__name__])[0]})
    else:
        _print_json_line({"done": True})
        return 0
    return 1


if __name__ == "__main__":
    sys.exit(run_job(sys.argv[1]))
