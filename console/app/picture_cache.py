"""Caches pictures of fields. A picture is loaded in a thread on first use; until then the map has
none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from topdress.console.app.field_picture import FieldPicture
from topdress.console.frame import Frame

if TYPE_CHECKING:
    from topdress.console.app.app import TopdressApp

PictureLoader = Callable[[Frame], FieldPicture | None]
# Pictures that stay in memory; an operator rarely compares more fields.
_MAX_CACHED_PICTURES = 4


class FieldPictures:
    """Loads pictures of fields in a thread. A ValueError of `load` is reported once, as one
    line."""

    def __init__(self, app: TopdressApp, load: PictureLoader | None) -> None:
        self._app, self._load = app, load
        self._known: dict[tuple[str, str], FieldPicture | None] = {}

    def find_picture(self, frame: Frame | None) -> FieldPicture | None:
        """Return the picture for a frame. The first call for a job starts the load and returns
        None."""
        if frame is None or self._load is None:
            return None
        key = (frame.log_path, frame.job)
        if key not in self._known:
            # The entry prevents a second load while the first still runs.
            self._known[key] = None
            self._app.run_with_files(
                partial(self._load, frame),
                partial(self._keep_picture, key),
                group="field",
                exclusive=False,
            )
        return self._known[key]

    def _keep_picture(self, key: tuple[str, str], picture: FieldPicture | None) -> None:
        # A dict keeps insertion order, so the oldest picture is dropped first.
        while len(self._known) > _MAX_CACHED_PICTURES:
            del self._known[next(iter(self._known))]
        self._known[key] = picture
        self._app.page.refresh_all_next_tick()
