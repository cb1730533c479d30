"""All pages of the console, by the word that their actions carry."""
from __future__ import annotations

from console.app.action import CALIBRATE, DEVICES, DIAGNOSIS, JOB, MAP, REPLAY, RUN, SETTINGS, TRENDS
from console.app.pages.calibrate.page import CalibrateScreen
from console.app.pages.devices.page import DevicesScreen
from console.app.pages.diagnosis.page import DiagnosisScreen
from console.app.pages.job.page import JobScreen
from console.app.pages.map.page import MapScreen
from console.app.pages.page import Page
from console.app.pages.replay.page import ReplayScreen
from console.app.pages.run.page import RunScreen
from console.app.pages.settings.page import SettingsScreen
from console.app.pages.trends.page import TrendsScreen
from console.app.replay_job import ReplayJob
from console.app.services import Services


def all_pages(replay: ReplayJob | None, services: Services) -> dict[str, Page]:
    """One of each. They are composed when they are first turned to."""
    return {
        RUN: RunScreen(),
        MAP: MapScreen(),
        TRENDS: TrendsScreen(),
        DEVICES: DevicesScreen(),
        CALIBRATE: CalibrateScreen(services.calibrate),
        REPLAY: ReplayScreen(replay),
        DIAGNOSIS: DiagnosisScreen(),
        JOB: JobScreen(),
        SETTINGS: SettingsScreen(),
    }
