"""A made-up job service for the Job screen's pictures and tests: every answer at once, nothing
read or written."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from topdress.console.app.field_picture import FieldPicture, PlannedRates
from topdress.console.app.frame_source import FrameSource
from topdress.console.app.pages.job.service import (
    FileChoice,
    IsCancelled,
    JobCard,
    JobFacts,
    JobNames,
    JobOffer,
    MapFile,
    MapPreview,
    MapReading,
    Progress,
    RecentSet,
)
from topdress.control.agronomy.reference_strips import StripMean
from topdress.control.field.job import make_rule
from topdress.control.machine.machine import Adopted
from topdress.control.targets.map_check import MapCheck
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import CROP_KIND
from topdress.drivers.files.run_setup import load_setup

NOMINAL = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
DURUM = load_config("osu_durum_2006", CROP_KIND).model  # which has nothing to be warned of
OF_CROP = {
    "name": "winter wheat",
    "flag": "",
    "examples": ("efficiency",),
    "response_index": "paper",
    "ndvi_nrich": None,
    "ndvi_check": None,
    "max_rate_kg_ha": 500.0,
    "fallback_rate_kg_ha": 260.0,
}
OF_JOB = {"title": "Topdressing winter wheat, division 2", "ndvi_nrich": 0.712}
OF_MACHINE = {
    "title": "huanghai",
    "adopted": (Adopted(id="flow.gain", size=3.1, unit="%", data="catch test", date="2026-03-18"),),
}


def facts_of(
    crop: Mapping[str, object] = {},
    job: Mapping[str, object] = {},
    machine: Mapping[str, object] = {},
    **others: Any,
) -> JobFacts:
    """Of a made-up job; what is other in its files, and of what stands next to them."""
    of_crop, of_job = (
        DURUM.model_copy(update=OF_CROP | crop),
        NOMINAL.job.model_copy(update=OF_JOB | job),
    )
    setup = replace(
        NOMINAL,
        crop=of_crop,
        job=of_job,
        rule=make_rule(of_crop, of_job, 82),
        machine=NOMINAL.machine.model_copy(update=OF_MACHINE | machine),
    )
    return JobFacts(
        setup,
        **{
            "job_file": "jobs/division-2.yaml",
            "crop_file": "crops/winter_wheat.yaml",
            "machine_file": "machines/huanghai-0318.yaml",
            "field": "division 2",
            "field_ha": 8.64,
            "jobs": (
                FileChoice("jobs/division-2.yaml", "division-2"),
                FileChoice("jobs/demo.yaml", "demo"),
            ),
            "crops": (
                FileChoice("crops/winter_wheat.yaml", "winter_wheat"),
                FileChoice("crops/durum.yaml", "durum"),
            ),
            "machines": (
                FileChoice("machines/huanghai-0318.yaml", "huanghai-0318"),
                FileChoice("machines/bench.yaml", "bench"),
            ),
        }
        | others,
    )


FACTS = facts_of()
CUT_OFF = JobOffer(
    "run.resume.json",
    "2026-03-18T06:18:00+00:00",
    "2026-03-18T07:02:00+00:00",
    "Topdressing winter wheat, division 2",
    1.2,
)


MAPS = (
    MapFile("/media/STICK/north.geojson", "north.geojson", "STICK", "2026-03-17 19:40"),
    MapFile("/media/STICK/zones.shp", "zones.shp", "STICK", "2026-03-16 08:12"),
)


RING = ((0.0, 0.0), (60.0, -4.0), (64.0, 40.0), (20.0, 55.0))
RECENT = (
    RecentSet(
        ("jobs/north-40.yaml", "machines/spreader.yaml", "cabs/red.yaml"),
        "Second dressing",
        "North 40",
        "Two-disc spreader",
        "2026-03-17T13:05:00Z",
        JobCard(
            "Second dressing",
            "North 40",
            "winter_wheat",
            "",
            0.86,
            "2026-03-17T15:20:00Z",
            FieldPicture("", (RING,)),
        ),
    ),
    RecentSet(
        ("jobs/division-2.yaml", "machines/huanghai.yaml"),
        "Huanghai, 23 February",
        "Huanghai, division 2",
        "Six-outlet fluted-roller applicator",
        "2026-03-14T06:30:00Z",
    ),
    RecentSet(("jobs/river.yaml",), "River field", "River field"),
)


class SampleJobService:
    """Keeps what was asked of it in `asked`. `trouble`: what every answer fails with;
    `cut_off`: what is offered."""

    def __init__(self, facts: JobFacts = FACTS, cut_off: JobOffer | None = None) -> None:
        self.known, self.cut_off = facts, cut_off
        self.asked: list[tuple[str, ...]] = []
        self.trouble = ""
        self.next: FrameSource | None = None

    def find_facts(self) -> JobFacts:
        self._fail()
        return self.known

    def find_free_bytes(self, log_path: str) -> int | None:
        return 83_000_000_000

    def choose_file(self, kind: str, value: str) -> None:
        self.asked.append(("take", kind, value))
        self._fail()

    def list_recent(self) -> tuple[RecentSet, ...]:
        return RECENT

    def choose_recent(self, recent: RecentSet) -> None:
        self.asked.append(("recent", *recent.files))
        self._fail()

    def drop_choices(self) -> None:
        self.asked.append(("drop",))

    def save_strip_value(self, strip: StripMean) -> str:
        self.asked.append(("strip", strip.which, f"{strip.ndvi:.3f}"))
        self._fail()
        return "jobs/division-2-strip.yaml"

    def list_maps(self) -> tuple[MapFile, ...]:
        self.asked.append(("maps",))
        return MAPS

    def list_map_folder(self, folder: str, kind: str = "map") -> tuple[MapFile, ...]:
        if not folder:
            return (MapFile("/media/STICK", "STICK/", "", ""),)
        if kind != "map":
            north = MapFile(f"{folder}/north.yaml", "north.yaml", "STICK", "2026-03-18")
            return (MapFile("/media", "..", "", ""), north)
        return (MapFile("/media", "..", "", ""), *self.list_maps())

    def preview_map(self, path: str, reading: MapReading) -> MapPreview:
        self.asked.append(("preview", path, *reading))
        self._fail()
        if path.endswith("zones.shp") and not reading.column:
            return MapPreview(path, reading, ("RATE_N", "ZONE"), f"{path}: rate column not chosen")
        rates = np.array(
            [[200.0 + 40.0 * ((row + column) % 4) for column in range(12)] for row in range(10)],
            np.float32,
        )
        picture = FieldPicture(
            "division 2",
            (((0.0, 0.0), (120.0, 0.0), (120.0, 100.0), (0.0, 100.0)),),
            1.2,
            2.4,
            PlannedRates(0.0, 0.0, 10.0, rates),
        )
        return MapPreview(
            path,
            reading._replace(column=reading.column or "rate"),
            ("rate", "zone"),
            "",
            f"{reading.unit or 'kg/ha'} (as the file names no unit)",
            1.2,
            312.0,
            (200.0, 320.0),
            picture,
            MapCheck(1.2, 1.2, 0.0, 0.0, 0.0, 0.0, 300.0, 0.3, 6.0, 320.0),
            "/tmp/kept.geojson",
        )

    def choose_map(self, preview: MapPreview) -> str:
        self.asked.append(("map", preview.path, *preview.reading))
        self._fail()
        return "jobs/division-2-map.yaml"

    def save_driven_boundary(self, ring_deg: tuple[tuple[float, float], ...]) -> str:
        self._fail()
        self.asked.append(("boundary", str(len(ring_deg))))
        return "/jobs/field-20260318-141500.yaml"

    def save_job_names(self, who: JobNames) -> str:
        self.asked.append(("who", *who))
        self._fail()
        return "jobs/division-2-who.yaml"

    def list_job_cards(self) -> tuple[tuple[FileChoice, JobCard | None], ...]:
        known = {
            "division-2": JobCard(
                "Topdressing winter wheat, division 2",
                "division 2",
                "winter_wheat",
                "north.geojson",
                1.18,
                "2026-03-18T07:02:00+00:00",
                FieldPicture("", (RING,)),
            )
        }
        return tuple((file, known.get(file.label)) for file in self.known.jobs)

    async def restart_worker(self, anew: bool = False) -> FrameSource:
        return self._source("restart anew" if anew else "restart")

    def export_as_applied(
        self, log_path: str, ending: str, progress: Progress, cancelled: IsCancelled
    ) -> tuple[str, ...]:
        self.asked.append(("export", log_path, ending))
        self._fail()
        return (f"run-applied{ending}",)

    def write_reports(
        self, log_path: str, progress: Progress, cancelled: IsCancelled
    ) -> tuple[str, ...]:
        self.asked.append(("report", log_path))
        self._fail()
        return ("run-report.html",)

    def find_offer(self) -> JobOffer | None:
        return self.cut_off

    async def resume_job(self, offer: JobOffer) -> FrameSource:
        return self._source("resume")

    async def start_anew(self, offer: JobOffer) -> FrameSource:
        return self._source("anew")

    def _source(self, asked: str) -> FrameSource:
        self.asked.append((asked,))
        self._fail()
        if self.next is None:
            raise OSError("no worker here")
        return self.next

    def _fail(self) -> None:
        if self.trouble:
            raise ValueError(self.trouble)
