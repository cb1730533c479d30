"""The Run screen: the machine at work."""
from __future__ import annotations

from typing import ClassVar

from console.app import actions
from console.app.history import Point, Spot
from console.app.screens.base import PanelScreen
from console.app.view import STALE_S, AlarmsView, RunView
from console.frame import Frame
from console.locale import _

GONE_AGE_S = STALE_S + 0.1


class RunScreen(PanelScreen):
    where: ClassVar[str] = actions.RUN

    def seen(self, now_s: float) -> tuple[Frame | None, float]:
        """Without a worker the last values are old at once."""
        age_s = self.app.arrival.age_s(now_s)
        return self.app.arrival.frame, max(age_s, GONE_AGE_S) if self.app.gone else age_s

    def seen_view(self, frame: Frame | None, age_s: float) -> RunView:
        view = super().seen_view(frame, age_s)
        if frame is None or view.alarms.lines:
            return view
        about = "   ".join(part for part in (frame.machine, frame.crop, frame.job, frame.log_path) if part)
        return view._replace(alarms=AlarmsView((), f"{view.alarms.calm}   {about}"))

    def points(self) -> tuple[Point, ...]:
        return self.app.history.recent()

    def spots(self) -> tuple[Spot, ...]:
        return tuple(self.app.history.track)

    def marks(self) -> tuple[str, ...]:
        gone = (_("WORKER GONE"),) if self.app.gone else ()
        return gone + super().marks()
