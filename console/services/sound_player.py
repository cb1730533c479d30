"""How do alarms sound? A command of the user is started and not waited for."""

from __future__ import annotations

import shlex
import subprocess


class SoundPlayer:
    """Plays one sound at a time; a request during a sound is ignored."""

    def __init__(self) -> None:
        self._playing: subprocess.Popen[bytes] | None = None

    def __call__(self, command: str) -> str:
        """Returns the reason why the sound could not be started, one line; empty if it plays, or if
        another sound still plays. Does not wait for its end."""
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
