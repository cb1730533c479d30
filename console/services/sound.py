"""Sounds of alarms: a command of the user's own, started and left to itself."""

from __future__ import annotations

import shlex
import subprocess


class SoundPlayer:
    """Plays one sound at a time; a request during a sound is left out."""

    def __init__(self) -> None:
        self._playing: subprocess.Popen[bytes] | None = None

    def __call__(self, command: str) -> str:
        """Why the sound could not be started, one line; empty where it plays, or one plays still.
        Does not wait for its end."""
        if self._playing is not None and self._playing.poll() is None:
            return ""
        try:
            words = shlex.split(command)
            self._playing = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            return f"{command}: {getattr(error, 'strerror', None) or error}"
        return ""
