"""The Run screen: the machine at work."""
from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult

from console.app.action import RUN, Action, bindings
from console.app.held_key import HeldKey
from console.app.pages.panel_page import PanelScreen
from console.app.pages.run.keys import ACTIONS
from console.app.pages.run.light_bar import LightBar, light_view
from console.app.pages.run.model_check import ModelCheck, model_check_texts
from console.app.pages.run.section_bar import SectionBar
from console.app.view import AlarmsView, RunView
from console.frame import Frame


class RunScreen(PanelScreen):
    where: ClassVar[str] = RUN
    BINDINGS: ClassVar = bindings(ACTIONS)

    def __init__(self) -> None:
        super().__init__()
        self.start_key = HeldKey()          # held down it lets the flow begin with the creep: the launch

    def perform(self, action: Action) -> None:
        """An order waits for nothing to be drawn."""
        action.do(self)

    def extra(self) -> ComposeResult:
        yield ModelCheck((), id="model-check")
        yield SectionBar((), id="section-bar")
        yield LightBar(None, id="light-bar")

    def show_numbers(self, view: RunView) -> None:
        super().show_numbers(view)
        frame, checked = self.app.arrival.frame, self.app.services.model_check
        lights = self.query_one("#light-bar", LightBar)
        light = light_view(self.app.guide, frame, view.status.silent != "", self.app.units)
        lights.display = light is not None
        lights.show(light)
        found = None if frame is None or checked is None else checked(frame.log_path)
        sections = self.query_one("#section-bar", SectionBar)
        sections.display = frame is not None and bool(frame.sections)
        sections.show(() if frame is None else frame.sections)
        bar = self.query_one("#model-check", ModelCheck)
        low = self.has_class("-low")
        # where rows are few alarms and the line come first
        bar.display = found is not None and not (low and (view.alarms.lines or lights.display))
        self.set_class(bar.display or lights.display, "-checked")
        if found is not None and frame is not None:
            bar.show(model_check_texts(found, frame, self.app.utc_offset_s))

    def seen_view(self, frame: Frame | None, age_s: float) -> RunView:
        view = super().seen_view(frame, age_s)
        if frame is None or view.alarms.lines or view.alarms.urgent:
            return view
        about = tuple(part for part in (frame.machine, frame.crop, frame.job, frame.log_path) if part)
        return view._replace(alarms=AlarmsView((), view.alarms.calm, about=about))
