"""Half-open connections at the tablet's server: does the page still come, how much is logged:
`python -m benchmarks tablet_crowd --connections 1100 --seconds 60`

`topdress serve` in a process that may open 1,024 files, on loopback; so many connections that
begin a request and never end it. Printed: how many times of one a second the page came whole,
its slowest, what the server wrote on stderr in a minute, its processor time, files open. POSIX.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import resource
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from verdict import exit_code

FILES = 1024
WAIT_S = 5.0  # for the page
MOST_BYTES_A_MINUTE = 20_000


def page_s(address: str) -> float | None:
    """Seconds until the whole page was there; None: it did not come."""
    began_s = time.monotonic()
    with contextlib.suppress(OSError):
        with urllib.request.urlopen(address, timeout=WAIT_S) as answer:
            whole = answer.read().rstrip().endswith(b"</html>")
        return time.monotonic() - began_s if whole else None
    return None


def open_half(port: int, count: int) -> list[socket.socket]:
    crowd = []
    for _ in range(count):
        with contextlib.suppress(OSError):
            one = socket.create_connection(("127.0.0.1", port), timeout=1.0)
            one.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1")
            crowd.append(one)
    return crowd


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connections", type=int, default=1100)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    resource.setrlimit(
        resource.RLIMIT_NOFILE, (min(20_000, resource.getrlimit(resource.RLIMIT_NOFILE)[1]),) * 2
    )
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        said = Path(folder) / "stderr"
        with said.open("wb") as stderr:
            server = subprocess.Popen(
                [
                    sys.executable,
                    "-c",
                    "from topdress.console.cli import main; main()",
                    "serve",
                    "--port",
                    str(port),
                ],
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                env=os.environ | {"HOME": folder, "XDG_RUNTIME_DIR": folder},
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, FILES)),
            )
        try:
            address = f"http://127.0.0.1:{port}/"
            deadline_s = time.monotonic() + 60.0
            while page_s(address) is None and time.monotonic() < deadline_s:
                time.sleep(0.1)
            crowd = open_half(port, given.connections)
            began_s, times = time.monotonic(), []
            while time.monotonic() < began_s + given.seconds:
                times.append(page_s(address))
                time.sleep(1.0)
            took_s = time.monotonic() - began_s
            files = len(list(Path(f"/proc/{server.pid}/fd").iterdir()))
            spent = [
                int(part)
                for part in Path(f"/proc/{server.pid}/stat")
                .read_text()
                .rsplit(")")[-1]
                .split()[11:13]
            ]
            for one in crowd:
                one.close()
        finally:
            server.terminate()
            server.wait(20.0)
        logged_mb = said.stat().st_size / 1e6 * 60.0 / took_s
    came = [one for one in times if one is not None]
    print(f"connections    {len(crowd)} half-open")
    print(
        f"page           {len(came)} of {len(times)} times, slowest {max(came, default=0.0):.2f} s"
    )
    print(f"stderr         {logged_mb:.3f} MB a minute")
    print(
        f"server         {sum(spent) / os.sysconf('SC_CLK_TCK'):.1f} s of processor, "
        f"{files} files open"
    )
    return exit_code(
        {
            "the page came every time": len(came) == len(times),
            f"at most {MOST_BYTES_A_MINUTE} bytes a minute are logged": logged_mb * 1e6
            <= MOST_BYTES_A_MINUTE,
        }
    )


if __name__ == "__main__":
    sys.exit(main())
