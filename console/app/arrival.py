"""When the newest frame arrived, by the console's own clock: the worker's may stand on another machine."""
from __future__ import annotations

from console.frame import Frame


class Arrival:
    def __init__(self) -> None:
        self.frame: Frame | None = None
        self._at_s = 0.0

    def see(self, frame: Frame | None, now_s: float) -> bool:
        """Take the newest frame; true when it is another than before."""
        if frame is None or (self.frame is not None and frame.seq == self.frame.seq and frame.at_s == self.frame.at_s):
            return False
        self.frame, self._at_s = frame, now_s
        return True

    def age_s(self, now_s: float) -> float:
        """Age of what is shown; 0 before the first frame."""
        return 0.0 if self.frame is None else max(0.0, now_s - self._at_s)
