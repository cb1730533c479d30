"""A made-up diagnosis for the gallery and the tests: the same every time, no file and no model
behind it."""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin
from typing import Any

from topdress.console.app.pages.diagnosis.service import (
    IMPORT_KIND,
    Adoption,
    AdoptionOffer,
    CauseCurves,
    ComparedRow,
    ComparisonView,
    DiagnosisSource,
    DiagnosisView,
    ExportKind,
    ImportNeedsAnswersError,
    ResidualCurve,
    StopSignal,
    TellProgress,
    WorkStopped,
)
from topdress.control.diagnosis.result import (
    Cause,
    Channel,
    DetectableSize,
    Diagnosis,
    FieldCost,
    Gain,
    NextRun,
    Rival,
    Size,
    SourceSummary,
    UnnamedEffect,
)
from topdress.control.machine.machine import CATALOGUE

SOURCES = (
    DiagnosisSource(
        "/data/logs/20260318-061200.csv",
        "20260318-061200.csv",
        "run",
        "2026-03-18 06:12",
        "1.2 MB",
        True,
    ),
    DiagnosisSource(
        "/data/logs/20260317-134500.csv",
        "20260317-134500.csv",
        "run",
        "2026-03-17 16:02",
        "23.6 MB",
    ),
    DiagnosisSource(
        "/data/logs/20260317-070100.csv",
        "20260317-070100.csv",
        "run",
        "2026-03-17 11:48",
        "31.0 MB",
    ),
    DiagnosisSource("/data/catch.csv", "catch.csv", "catch", "2026-03-16 09:20", "0.6 kB"),
    DiagnosisSource("/data/lag_table.csv", "lag_table.csv", "lag", "2026-03-12 17:31", "0.4 kB"),
)

_SAG = Cause(
    "shaft.voltage_sag",
    Size(3.1, 2.8, 3.4, "% lost per V"),
    None,
    0.998,
    (),
    None,
    CATALOGUE["shaft.voltage_sag"].effect.advice,
    FieldCost(-2.4, None),
)
_SAG_DRAWN = CauseCurves(
    ResidualCurve(
        "shaft",
        "r/min",
        "supply_v",
        tuple(12.0 + 0.15 * k for k in range(11)),
        tuple(-3.2 + 0.31 * k + 0.05 * sin(3 * k) for k in range(11)),
        tuple(0.06 * cos(2 * k) for k in range(11)),
        (0.08,) * 11,
    ),
    ResidualCurve(
        "shaft",
        "r/min",
        "time_s",
        tuple(0.5 + k for k in range(40)),
        tuple(-1.6 + 1.1 * sin(0.3 * k) for k in range(40)),
        tuple(0.09 * sin(1.7 * k) for k in range(40)),
        (0.1,) * 40,
    ),
)

_FILL = Cause(
    "flow.fill_falloff",
    Size(12.4, 9.9, 14.8, "% lost at 100 r/min"),
    None,
    0.58,
    (Rival("flow.gain", 0.27), Rival("scale.gain", 0.15)),
    None,
    "Work at a larger opening and a lower shaft speed.",
    FieldCost(-6.1, None),
)
_FILL_DRAWN = CauseCurves(
    ResidualCurve(
        "flow",
        "g/s",
        "shaft_rpm",
        (20.0, 35.0, 50.0, 60.0, 70.0, 80.0),
        (-0.4, -1.3, -2.6, -3.9, -5.2, -6.8),
        (0.2, -0.3, 0.1, 0.2, -0.2, 0.1),
        (0.5, 0.5, 0.6, 0.6, 0.7, 0.8),
    ),
    ResidualCurve(
        "flow",
        "g/s",
        "time_s",
        tuple(1.2 + 2.5 * k for k in range(16)),
        tuple(-4.8 + 0.8 * sin(k) for k in range(16)),
        tuple(0.4 * cos(2 * k) for k in range(16)),
        (0.6,) * 16,
    ),
)

_CHANNELS = tuple(
    Channel(name, unit, 48_240, 0.0, error, noise, 0.9, p)
    for name, unit, error, noise, p in (
        ("shaft", "r/min", 1.92, 0.285, 0.0),
        ("gate", "mm", 0.1005, 0.1004, 0.5),
        ("flow", "kg/s", 0.0149, 0.0121, 0.0),
        ("scale", "kg", 2.27, 0.127, 0.0),
        ("speed", "m/s", 0.0359, 0.0358, 0.5),
        ("heads", "NDVI", 0.0164, 0.0163, 0.5),
    )
)
_AFTER = {"shaft": 0.287, "gate": 0.1004, "scale": 0.146, "speed": 0.0359, "heads": 0.0164}
_STAIRS = "Shaft staircase: 20, 40, 60, 80 r/min for a minute each at one opening, twice."


def having(view: DiagnosisView, **changes: Any) -> DiagnosisView:
    """With another diagnosis in it, as `dataclasses.replace` makes it."""
    return view._replace(found=replace(view.found, **changes))


def sample_found(verdict: str = "ambiguous") -> DiagnosisView:
    """ambiguous: two causes, of which one has rivals; named: one; none: nothing."""
    unseen = tuple(UnnamedEffect(f"effect.{k}", DetectableSize(None, "")) for k in range(17))
    view = DiagnosisView(
        "20260317-134500.csv",
        Diagnosis(
            SourceSummary("/data/logs/20260317-134500.csv", "run", 48_240, 2412.0, "huanghai"),
            _CHANNELS,
            "ambiguous",
            (_FILL, _SAG),
            unseen,
            (),
            NextRun("", _STAIRS, "stairs", 10.0),
            (Gain("shaft", "rmse, r/min", 1.91, 0.288, 0.28, 0.3, ""),),
            None,
        ),
        (_FILL_DRAWN, _SAG_DRAWN),
        _AFTER,
        ("flow.fill_falloff", "shaft.voltage_sag"),
        (),
        "stairs",
        None,
        324.6,
        "/tmp/made-up",
        offers=(
            AdoptionOffer(
                ("shaft.voltage_sag",),
                "machine-0.yaml",
                ("  shaft.voltage_sag: 0 -> 3.1 % lost per V",),
            ),
            AdoptionOffer(
                ("flow.fill_falloff", "shaft.voltage_sag"),
                "machine-1.yaml",
                (
                    "  flow.fill_falloff: 0 -> 12.4 % lost at 100 r/min",
                    "  shaft.voltage_sag: 0 -> 3.1 % lost per V",
                ),
            ),
        ),
    )
    if verdict == "named":
        one = view._replace(
            source="separating.csv",
            drawn=(_FILL_DRAWN,),
            adoptable=("flow.fill_falloff",),
            drives="",
            offers=(
                AdoptionOffer(("flow.fill_falloff",), "machine-0.yaml", view.offers[1].changes[:1]),
            ),
            planted=("flow.fill_falloff=12",),
        )
        return having(
            one,
            data=replace(view.found.data, rows=10_000, duration_s=500.0),
            verdict="named",
            causes=(replace(_FILL, rivals=(), probability=0.97),),
            next_run=None,
        )
    if verdict == "none":
        return having(
            view._replace(drawn=(), after={}, adoptable=(), drives="", offers=()),
            verdict="none",
            causes=(),
            gain=(),
            next_run=None,
            channels=tuple(
                replace(one, rmse=one.noise_floor, structure_p=0.5) for one in _CHANNELS
            ),
        )
    return view


OPEN = ImportNeedsAnswersError(
    (
        "/data/planter.csv: columns.opening_mm: Schieberöffnung is in %: the file does not "
        "say what "
        "100 % is in mm",
    ),
    "/data/planter.import.yaml",
)


class MadeUpDiagnosis:
    """A `DiagnosisService` that knows its answers; it keeps what it was asked. wait: until when
    work goes on."""

    def __init__(
        self, found: DiagnosisView | None = None, refuse: str = "", unsure: tuple[str, ...] = ()
    ) -> None:
        self.found = found or sample_found()
        self.refuse, self.unsure = refuse, unsure
        self.asked: list[str] = []
        self.installed = True

    def list_sources(self, running_log: str) -> tuple[DiagnosisSource, ...]:
        return SOURCES

    def find_source(self, path: str) -> DiagnosisSource:
        if not path.endswith((".csv", ".xlsx")):
            raise ValueError(
                f"{path}: neither a run log (column time_s), a bench table nor a log that "
                "import reads"
            )
        return SOURCES[1]._replace(
            path=path,
            name=path.rsplit("/", 1)[-1],
            kind=IMPORT_KIND if path.endswith(".xlsx") else "run",
        )

    def is_installed(self) -> bool:
        return self.installed

    def install_extra(self, tell: TellProgress, stop: StopSignal) -> None:
        self.asked.append("install")
        self._work(tell, stop)
        self.installed = True

    def list_machines(self) -> tuple[str, ...]:
        return ("bench", "huanghai")

    def run_diagnosis(
        self, source: DiagnosisSource, machine: str | None, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        self.asked.append(f"diagnose {source.name} {machine}")
        self._work(tell, stop)
        return self.found

    def drive_separating_run(
        self, found: DiagnosisView, tell: TellProgress, stop: StopSignal
    ) -> DiagnosisView:
        self.asked.append(f"drive {found.drives}")
        self._work(tell, stop)
        return sample_found("named")

    def compare_machines(
        self, machine: str, source: DiagnosisSource, tell: TellProgress, stop: StopSignal
    ) -> ComparisonView:
        self.asked.append(f"compare {machine} {source.name}")
        self._work(tell, stop)
        return ComparisonView(
            (
                ComparedRow("shaft", "r/min", 1.92, 0.29, 1.5, 1.8),
                ComparedRow("gate", "mm", 0.1, 0.1, 0.0, 0.0),
                ComparedRow("flow", "kg/s", 0.012, 0.015, -0.004, -0.002),
            ),
            "/data/reports/compared.html",
        )

    def _work(self, tell: TellProgress, stop: StopSignal) -> None:
        tell(0.5, "metering")
        if stop.is_set():
            raise WorkStopped
        if self.unsure:
            raise ImportNeedsAnswersError(self.unsure, "/data/planter.import.yaml")
        if self.refuse:
            raise ValueError(self.refuse)

    def adopt_effects(self, found: DiagnosisView, chosen: Adoption) -> str:
        self.asked.append(
            f"adopt {', '.join(chosen.ids)}" + (f": {chosen.why}" if chosen.why else "")
        )
        return "/data/machines/huanghai-2026-03-18.yaml"

    def describe_last_change(self, machine: str | None) -> tuple[str, ...]:
        return (
            ()
            if machine is None
            else ("2026-03-18, from 20260317-134500.csv", "  flow.gain: 0 -> 3 %")
        )

    def undo_last_change(self, machine: str | None) -> str:
        self.asked.append(f"take back {machine}")
        return "/data/machines/bench-2026-03-19.yaml"

    def export_result(self, found: DiagnosisView, what: ExportKind) -> str:
        self.asked.append(f"export {what}")
        return "/data/reports/20260317-134500-diagnosis.html"

    def write_separating_job(self, found: DiagnosisView) -> str:
        self.asked.append("write_run")
        return "/data/jobs/separate_stairs.yaml"
