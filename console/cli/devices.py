"""How does `topdress devices` list ports and the devices on them?"""

from __future__ import annotations

import time
from typing import Annotated

import typer
from topdress.console.cli.plain_errors import EXIT_FAILED
from topdress.console.cli.plain_output import AsJson, print_json


def list_devices(
    ports: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PORT...]",
            help="Serial ports, socket://HOST:PORT or "
            "udp://HOST:PORT. Without it: every serial port of this "
            "computer, and rate modules on the network.",
        ),
    ] = None,
    baud: Annotated[
        int | None,
        typer.Option(metavar="NUMBER", min=300, max=4_000_000, help="Listen at this rate only."),
    ] = None,
    seconds: Annotated[
        float,
        typer.Option(metavar="SECONDS", min=0.2, max=60.0, help="Listen this long at each rate."),
    ] = 1.2,
    no_probe: Annotated[bool, typer.Option("--no-probe", help="List only; open nothing.")] = False,
    as_json: AsJson = False,
) -> None:
    """List the ports and what speaks on them. Listens only: nothing is sent to any device."""
    from serial.tools.list_ports import comports
    from topdress.drivers.devices.protocol_probe import PROBE_BAUD_RATES
    from topdress.drivers.devices.rate_module import DEFAULT_CONSOLE_PORT

    descriptions = {one.device: one.description or "" for one in sorted(comports())}
    urls = list(ports) if ports else list(descriptions)
    if not urls and not as_json:
        typer.echo("no serial port on this computer")
    if not ports and not no_probe:
        descriptions[every := f"udp://0.0.0.0:{DEFAULT_CONSOLE_PORT}"] = (
            "rate modules on the network"
        )
        urls.append(every)
    failed = False
    for url in urls:
        said, opened = (
            ("", True)
            if no_probe
            else _probe_modules(url, seconds)
            if url.startswith("udp://")
            else _probe_port(
                url,
                [baud]
                if baud
                else [115200]
                if url.startswith("socket://")
                else list(PROBE_BAUD_RATES),
                seconds,
            )
        )
        failed |= bool(ports) and not opened
        description = descriptions.get(url, "")
        if as_json:
            print_json({"port": url, "description": description, "opened": opened, "said": said})
        else:
            typer.echo(
                "  ".join(part for part in (f"{url:32}", description, said) if part).rstrip()
            )
    if failed:
        raise typer.Exit(EXIT_FAILED)


def _probe_port(url: str, bauds: list[int], seconds: float) -> tuple[str, bool]:
    """Returns a description of the device at a port, and whether the port could be opened."""
    from topdress.drivers.devices.protocol_probe import probe_port
    from topdress.drivers.ports import open_port

    found = probe_port(lambda rate: open_port(url, rate, time.monotonic), bauds, listen_s=seconds)
    if not found.protocol:
        return (
            f"{'nothing known speaks' if found.opened else 'cannot be opened'}: {found.detail}",
            found.opened,
        )
    rate = "" if url.startswith("socket://") else f" at {found.baud} Bd"
    said = (
        f"{found.protocol}{rate}: {found.accepted} understood, {found.rejected} rejected; "
        f"last: {found.detail}"
    )
    return said, True


def _probe_modules(url: str, seconds: float) -> tuple[str, bool]:
    from topdress.drivers.datagrams import UdpPort
    from topdress.drivers.devices.protocol_probe import recognise_modules

    port = UdpPort(url, time.monotonic)
    heard: list[bytes] = []
    until_s = time.monotonic() + seconds
    try:
        while time.monotonic() < until_s:
            heard += port.read_each()
            time.sleep(0.02)
        trouble = port.state().last_error
    finally:
        port.close()
    found = recognise_modules(heard)
    names = ", ".join(
        f"rate module {number}" + (f" ({label})" if label else "")
        for number, label in found.items()
    )
    return names or (f"cannot listen: {trouble}" if trouble else "none heard"), not trouble
