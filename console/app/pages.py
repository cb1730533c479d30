"""All pages of the console, by the word that their actions carry."""
from __future__ import annotations

from console.app.action import CALIBRATE, DEVICES, DIAGNOSIS, JOB, MAP, REPLAY, RUN, SETTINGS, TRENDS
from console.app.replay_job import ReplayJob
from console.app.screens.calibrate import CalibrateScreen
from console.app.screens.devices import DevicesScreen
from console.app.screens.diagnosis import DiagnosisScreen
from console.app.screens.job import JobScreen
from console.app.screens.map import MapScreen
from console.app.screens.page import Page
from console.app.screens.replay import ReplayScreen
from console.app.screens.run import RunScreen
from console.app.screens.settings import SettingsScreen
from console.app.screens.trends import TrendsScreen
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
