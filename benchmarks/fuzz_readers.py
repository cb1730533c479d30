"""Every reader and link fed with what nobody would send: `python benchmarks/fuzz_readers.py --state FOLDER`

Coverage-guided by atheris (libFuzzer for Python; `pip install atheris`), a process for each target and turn: the corpus
of each target is kept in FOLDER and grows, and a further call goes on until the inputs of all targets together are so
many; every target has had the same time. Without atheris, or with `--plain`, inputs are mutated from the seeds alone.

A target may refuse its input by a ValueError or an OSError in one line; anything else is a finding, kept in FOLDER with
its bytes, and makes the exit code 1. So does a target that accepted none of its seeds. Printed by target: inputs,
accepted, inputs a second, edges covered (atheris), findings.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from verdict import exit_code

ROOT = Path(__file__).resolve().parents[1]
MEMORY_BYTES = 4 << 30
SECONDS_A_TURN = 60
HANGS = 70  # libFuzzer's exit code where one input took longer than its timeout
LONGEST = 8192
MOST_OF_ALL = 0.1           # of the inputs: a quick target shall not stand for the slow ones
Target = Callable[[bytes], object]
ONE_LINE = "refused in more than one line"


def of_file(read: Callable[[Path], object], suffix: str) -> Target:
    """A reader of a file: the input is the file."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    path = folder / f"x{suffix}"

    def run(data: bytes) -> object:
        path.write_bytes(data)
        return read(path)

    return run


def of_decoder(make: Callable[[], Any]) -> Target:
    """A decoder: the input in two pieces, then a good line is no business of this."""

    def run(data: bytes) -> object:
        decoder = make()
        half = len(data) // 2
        return [*decoder.feed(data[:half], 1.0), *decoder.feed(data[half:], 1.05)]

    return run


def targets() -> dict[str, tuple[Target, list[bytes]]]:
    """Name -> what is fed, and seeds."""
    from console.worker import resume
    from console.worker.requests import parse
    from drivers.devices.agopengps import AgOpenGpsDecoder
    from drivers.devices.canopy_heads import PROTOCOLS, HeadDecoder
    from drivers.devices.gnss import GnssDecoder
    from drivers.devices.gpsd import GpsdDecoder
    from drivers.devices.lag_rig import LagRig
    from drivers.devices.rate_module import ModuleAddress, RateModule
    from drivers.devices.slave_board import SlaveBoard
    from drivers.files.bench_table import read_bench_table
    from drivers.files.config import ConfigError
    from drivers.files.imports.read import read_raw
    from drivers.files.prescriptions.plants import read_plants
    from drivers.files.prescriptions.read import read_prescription
    from drivers.files.read_log import read_log
    from drivers.files.setup import by_kind
    from drivers.files.weather import read_weather
    from drivers.files.yaml_text import parse_yaml

    def module(data: bytes) -> object:
        return RateModule(ModuleAddress(), 360.0, 100.0).feed([data[:20], data], 1.0)

    def log(path: Path) -> object:
        return list(read_log(path).rows())

    def config(path: Path) -> object:
        try:
            return by_kind([str(path)])
        except ConfigError as error:
            raise ValueError(error.lines[0]) from None

    def yaml(data: bytes) -> object:
        return parse_yaml(data.decode("utf-8", "replace"))

    def request(data: bytes) -> object:
        return parse(data, "key")

    geo = (
        b'{"type":"FeatureCollection","features":[{"type":"Feature","geometry":{"type":"Polygon","coordinates":'
        b'[[[119,34],[119.001,34],[119.001,34.001],[119,34]]]},"properties":{"rate":300}}]}'
    )
    points = (
        b'{"type":"FeatureCollection","features":[{"type":"Feature","geometry":{"type":"Point","coordinates":'
        b'[119,34]},"properties":{"rate":300}}]}'
    )
    task = (
        b'<?xml version="1.0"?><ISO11783_TaskData VersionMajor="4"><TSK A="TSK1" G="1"><TZN A="1"><PDV A="0006" '
        b'B="30000"/><PLN A="1"><LSG A="1"><PNT A="2" C="34" D="119"/><PNT A="2" C="34.1" D="119"/><PNT A="2" '
        b'C="34" D="119.1"/></LSG></PLN></TZN></TSK></ISO11783_TaskData>'
    )
    table = b"time_s,shaft_rpm,opening_mm,lat_deg,lon_deg,heading_deg,state\n" + b"".join(
        b"%.2f,%d,25,34.%04d,119,0,working\n" % (0.05 * k, 60 + k % 7, k) for k in range(60)
    )
    sentence = b"$GPGGA,080012.30,3416.80000,N,11952.80000,E,4,14,0.8,31.0,M,,M,,*6F\r\n"
    return {
        "request": (
            request,
            [
                b'{"id":1,"token":"key","do":"refill","value":3}',
                b'{"id":1,"token":"key","device":"gnss","act":"test"}',
                b'{"id":1,"ask":"look"}',
            ],
        ),
        "gnss": (of_decoder(GnssDecoder), [sentence * 2, b"$GPRMC,1,A\n", b"#x\n"]),
        "gpsd": (
            of_decoder(GpsdDecoder),
            [
                b'{"class":"TPV","mode":3,"lat":34.1,"lon":119,"speed":1.2,"track":3,'
                b'"time":"2026-01-01T00:00:00.1Z"}\n',
                b'{"class":"SKY","hdop":1}\n',
            ],
        ),
        "agopengps": (
            of_decoder(AgOpenGpsDecoder),
            [b"\x80\x81\x7f\xfe\x08" + bytes(8) + b"\x85", b"\x80\x81\x7f\x64\x18" + bytes(24) + b"\xfb"],
        ),
        "heads": (of_decoder(lambda: HeadDecoder(PROTOCOLS["greenseeker"], head=None)), [b"H1,1,2,0.5,3,4\r\n" * 3]),
        "board": (of_decoder(SlaveBoard), [b"$S1,0,0,1000000,0,0,60.0,25.0,250.0,13.5,,,1,1*ABCD\r\n"]),
        "lag rig": (of_decoder(LagRig), [b"$L1,1,1,0,100,0.0,0,,,0*ABCD\r\n"]),
        "rate module": (module, [b"\x90\x7e\x00" + bytes(12), b"\x91\x7e\x00" + bytes(12)]),
        "yaml": (yaml, [b"format: topdress-job/1\nid: a\nx: [1, {b: 2.5}]\n", b"a: &x [1]\nb: *x\n"]),
        "config": (of_file(config, ".yaml"), [(ROOT / "configs/jobs/demo.yaml").read_bytes()[:LONGEST]]),
        "run log": (of_file(log, ".csv"), [table, table.replace(b",", b";").replace(b".", b",")]),
        "bench table": (
            of_file(lambda path: read_bench_table(path, None), ".csv"),
            [b"shaft_rpm,lag_s\n10,2.1\n20,2.0\n30,1.9\n", b"shaft_rpm,opening_mm,duration_s,mass_kg\n1,2,3,4\n"],
        ),
        "weather": (of_file(read_weather, ".csv"), [b"date,mean_temp_c\n2013-11-01,10\n2013-11-02,11\n"]),
        "plants": (of_file(read_plants, ".csv"), [b"lat_deg,lon_deg\n34,119\n34.1,119\n"]),
        "plants json": (of_file(read_plants, ".geojson"), [points]),
        "import text": (of_file(read_raw, ".csv"), [table, b"Zeit;Menge\n1,5;2,5\n2,5;3\n"]),
        "import json": (of_file(read_raw, ".geojson"), [points]),
        "map json": (of_file(read_prescription, ".geojson"), [geo]),
        "map task": (of_file(read_prescription, ".xml"), [task]),
        "map zip": (of_file(read_prescription, ".zip"), [_zipped(task)]),
        "resume": (of_file(resume.read, ".resume.json"), [b'{"format":"topdress-resume/1","log_path":"x","sums":{}}']),
    }


def _zipped(task: bytes) -> bytes:
    import io
    import zipfile

    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr("TASKDATA/TASKDATA.XML", task)
    return made.getvalue()


class Fed:
    """One target and what became of its inputs. `one` is what the fuzzer calls."""

    def __init__(self, name: str, folder: Path) -> None:
        self._name, self._folder = name, folder
        self._target, self.seeds = targets()[name]
        self.inputs = self.accepted = self.findings = 0
        self.slowest_ms = 0.0
        self._kinds: set[str] = set()

    def one(self, data: bytes) -> None:
        self.inputs += 1
        began_s = time.thread_time()
        try:
            self._target(data)
            self.accepted += 1
        except (ValueError, OSError) as error:
            if len(str(error).splitlines()) > 1:
                self._keep(ONE_LINE, data)
        except RecursionError as error:
            self._keep(f"RecursionError: {error}", data)
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            self._keep(f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {error}"[:160], data)
        self.slowest_ms = max(self.slowest_ms, 1e3 * (time.thread_time() - began_s))

    def _keep(self, said: str, data: bytes) -> None:
        kind = re.sub(r"[0-9]{3,}", "#", said.split(": ")[0])
        if kind in self._kinds:
            return
        self._kinds.add(kind)
        self.findings += 1
        place = self._folder / "findings"
        place.mkdir(parents=True, exist_ok=True)
        stem = re.sub(r"\W+", "-", f"{self._name} {kind}")[:80]
        (place / f"{stem}.bin").write_bytes(data)
        (place / f"{stem}.txt").write_text(said)

    def told(self) -> dict[str, Any]:
        return {
            "inputs": self.inputs,
            "accepted": self.accepted,
            "findings": sorted(self._kinds),
            "slowest_ms": self.slowest_ms,
        }


def mutated(seed: bytes, other: bytes, chance: random.Random) -> bytes:
    """One to four changes: a byte, a stretch doubled, dropped or replaced, a splice, a number of odd size."""
    data = bytearray(seed)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(data) + 1)
        kind = chance.randrange(6)
        if kind == 0 and data:
            data[at % len(data)] = chance.randrange(256)
        elif kind == 1:
            data[at:at] = data[at : at + chance.randint(1, 40)]
        elif kind == 2:
            del data[at : at + chance.randint(1, 20)]
        elif kind == 3:
            data[at:] = other[chance.randrange(len(other) + 1) :]
        elif kind == 4:
            data[at : at + chance.randint(0, 3)] = chance.choice(
                (
                    b"1e308",
                    b"-1",
                    b"NaN",
                    b"9" * 50,
                    b"[",
                    b"{",
                    b'"',
                    b"\0",
                    b"\r",
                    b"\xff\xfe",
                    b"<",
                    b"&",
                    b"null",
                    b",,,",
                )
            )
        else:
            data[at:at] = chance.randbytes(chance.randint(1, 8))
    return bytes(data[:LONGEST])


def plainly(fed: Fed, inputs: int, seconds: float, seed: int) -> None:
    chance = random.Random(seed)
    until_s = time.monotonic() + seconds
    for data in fed.seeds:
        fed.one(data)
    while fed.inputs < inputs and time.monotonic() < until_s:
        fed.one(mutated(chance.choice(fed.seeds), chance.choice(fed.seeds), chance))


def child(given: argparse.Namespace) -> None:
    """One target for one turn, in a process of its own."""
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    out = given.state / f"{given.child.replace(' ', '-')}.turn.json"
    if given.plain:
        fed = Fed(given.child, given.state)
        plainly(fed, given.inputs, SECONDS_A_TURN, given.seed)
        out.write_text(json.dumps(fed.told()))
        return
    import atheris

    with atheris.instrument_imports(include=["drivers", "console.worker", "control"]):
        fed = Fed(given.child, given.state)
    corpus = given.state / "corpus" / given.child.replace(" ", "-")
    corpus.mkdir(parents=True, exist_ok=True)
    for number, data in enumerate(fed.seeds):
        (corpus / f"seed-{number}").write_bytes(data)
    last_s = [time.monotonic()]

    def one(data: bytes) -> None:
        fed.one(data)
        if fed.inputs % 512 == 0 and time.monotonic() - last_s[0] > 1.0:
            last_s[0] = time.monotonic()
            out.write_text(json.dumps(fed.told()))
        if fed.inputs >= given.inputs:
            out.write_text(json.dumps(fed.told()))
            os._exit(0)

    atheris.Setup(
        [
            sys.argv[0],
            str(corpus),
            f"-max_len={LONGEST}",
            f"-max_total_time={SECONDS_A_TURN}",
            "-rss_limit_mb=0",
            f"-timeout={SECONDS_A_TURN}",  # of one input: kept as timeout-... in FOLDER, and a finding
            f"-seed={given.seed}",
            "-print_final_stats=1",
            f"-artifact_prefix={given.state}/",
        ],
        one,
    )
    atheris.Fuzz()


def turn(name: str, given: argparse.Namespace, inputs: int, seed: int) -> dict[str, Any]:
    """One process; its figures, and the edges that it says to have covered."""
    out = given.state / f"{name.replace(' ', '-')}.turn.json"
    out.unlink(missing_ok=True)
    command = [
        sys.executable,
        str(Path(__file__).resolve()),
        "--child",
        name,
        "--inputs",
        str(inputs),
        "--seed",
        str(seed),
        "--state",
        str(given.state),
        *(["--plain"] if given.plain else []),
    ]
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env=environment,
            errors="replace",
            check=False,
            timeout=SECONDS_A_TURN * 5,
        )
        code, said = done.returncode, done.stderr
    except subprocess.TimeoutExpired:
        code, said = None, "did not end"
    found: dict[str, Any] = (
        json.loads(out.read_text()) if out.exists() else {"inputs": 0, "accepted": 0, "findings": []}
    )
    covered = re.findall(r"\bcov: (\d+)", said)
    if code == HANGS or (out.exists() and code is None) or (not out.exists() and code is not None) or (
        code not in (0, 77, None) and given.plain
    ):
        found["findings"] = [*found["findings"], f"process ended with {code}: {said.strip()[-120:]}"]
    return found | {"covered": int(covered[-1]) if covered else 0, "late": code is None and not out.exists()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000_000, help="over all targets")
    parser.add_argument("--state", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="targets whose name contains this")
    parser.add_argument("--plain", action="store_true", help="mutate seeds, without atheris")
    parser.add_argument(
        "--seconds", type=float, default=float("inf"), help="stop after so long; a further call goes on"
    )
    parser.add_argument("--child", help=argparse.SUPPRESS)
    given = parser.parse_args()
    given.state.mkdir(parents=True, exist_ok=True)
    if given.child is not None:
        child(given)
        return
    kept = given.state / "done.json"
    done: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else {}
    names = [name for name in targets() if given.only is None or given.only in name]
    until_s = time.monotonic() + given.seconds

    most = max(MOST_OF_ALL, 1.0 / max(1, len(names))) * given.inputs

    def fed() -> float:
        return sum(min(most, done.get(name, {}).get("inputs", 0)) for name in names)

    dead: set[str] = set()
    while fed() < given.inputs and not dead >= set(names) and time.monotonic() < until_s:
        for name in names:  # a turn of the same time for each: a decoder gets more inputs than a reader of zips
            enough = done.get(name, {}).get("inputs", 0) >= most
            if enough or name in dead or fed() >= given.inputs or time.monotonic() > until_s:
                continue
            before = done.setdefault(name, {"inputs": 0, "accepted": 0, "findings": [], "covered": 0, "seconds": 0.0})
            began_s = time.monotonic()
            found = turn(name, given, int(most - before["inputs"]), given.seed + before["inputs"] % 100_000)
            before["inputs"] += found["inputs"]
            before["accepted"] += found["accepted"]
            before["covered"] = max(before["covered"], found["covered"])
            before["findings"] = sorted({*before["findings"], *found["findings"]})
            before["seconds"] += time.monotonic() - began_s
            if found["inputs"] == 0 and not found["late"]:  # a busy computer may not even get it started in a turn
                dead.add(name)
                before["findings"] = sorted({*before["findings"], "does not run"})
            kept.write_text(json.dumps(done, indent=1))
    print("| target | inputs | accepted | a second | edges | findings |\n|---|---|---|---|---|---|")
    for name in names:
        one = done.get(name, {"inputs": 0, "accepted": 0, "findings": [], "covered": 0, "seconds": 1.0})
        print(
            f"| {name} | {one['inputs']} | {one['accepted']} | {one['inputs'] / max(1e-9, one['seconds']):.0f} | "
            f"{one['covered']} | {'; '.join(one['findings']) or '-'} |"
        )
    print(f"inputs altogether: {sum(done[name]['inputs'] for name in names if name in done)}")
    sys.exit(
        exit_code(
            {f"{name}: no findings": not done.get(name, {}).get("findings") for name in names}
            | {f"{name}: at least one input": done.get(name, {}).get("inputs") for name in names}
        )
    )


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
