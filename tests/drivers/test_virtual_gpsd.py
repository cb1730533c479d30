"""The virtual gpsd: several clients at once, each with a watch of its own, and the questions that clients ask."""
from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator

import pytest

from control.readings import DriveCommand
from drivers.devices.gpsd import GpsdDecoder
from drivers.virtual.faults import PortFaults
from drivers.virtual.gpsd import GpsdServer, VirtualGpsd

STOP = DriveCommand(0.0, 25.0)
Step = Callable[[], None]


@pytest.fixture
def served(clock, fake_plant) -> Iterator[tuple[GpsdServer, Step]]:
    server = GpsdServer("127.0.0.1", 0, clock, seed=1)
    virtual = VirtualGpsd(server)

    def step() -> None:
        virtual.before(clock.now_s, STOP, False)
        virtual.after(fake_plant.step(STOP, False), clock.now_s)
        clock.now_s += 0.05
        time.sleep(0.003)
    yield server, step
    server.close()


class Client:
    def __init__(self, server: GpsdServer, step: Step) -> None:
        self._socket = socket.create_connection(("127.0.0.1", server.number), timeout=5.0)
        self._socket.setblocking(False)
        self._step = step
        self.said = b""

    def ask(self, question: bytes = b"", steps: int = 12) -> list[dict]:
        """What comes within some steps of the plant."""
        if question:
            self._socket.send(question)
        before = len(self.said)
        for _ in range(steps):
            self._step()
            try:
                self.said += self._socket.recv(65536)
            except BlockingIOError:
                pass
        return [json.loads(line) for line in self.said[before:].splitlines()]

    def close(self) -> None:
        self._socket.close()


def classes(said: list[dict]) -> list[str]:
    return [one["class"] for one in said]


def test_questions_are_answered_as_gpsd_does(served):
    client = Client(*served)
    assert classes(client.ask()) == ["VERSION"], "greeted, and nothing else unasked"
    assert classes(client.ask(b"?VERSION;\n")) == ["VERSION"]
    assert classes(client.ask(b"?DEVICES;\r\n")) == ["DEVICES"]
    poll, = client.ask(b"?POLL;\n")
    assert poll["class"] == "POLL" and poll["active"] == 1
    assert poll["tpv"][0]["lat"] == pytest.approx(34.28, abs=1e-3) and poll["sky"][0]["uSat"] == 14
    assert classes(client.ask(b"?NONSENSE;\n")) == ["ERROR"]
    watch = client.ask(b"?WATCH;\n")
    assert classes(watch) == ["WATCH"] and watch[0]["enable"] is False
    assert classes(client.ask(b'?WATCH={"enable":tr\n')) == ["ERROR"]
    on = classes(client.ask(b'?WATCH={"enable":true,"json":true};\n'))
    assert on[:2] == ["DEVICES", "WATCH"] and set(on[2:]) == {"SKY", "TPV"}
    off = client.ask(b'?WATCH={"enable":false};\n')
    assert classes(off)[-2:] == ["DEVICES", "WATCH"] and classes(client.ask()) == []
    client.close()


def test_a_poll_is_read_as_a_fix(served):
    client = Client(*served)
    client.ask()
    client.ask(b"?POLL;\n")
    decoder = GpsdDecoder()
    fix, = decoder.feed(client.said, 0.0)
    assert (fix.fix_quality, fix.satellites, fix.speed_mps) == (4, 14, 1.25)
    assert not decoder.counts.rejected
    assert GpsdDecoder().feed(b'{"class":"POLL","tpv":[],"sky":[]}\n{"class":"POLL","tpv":3}\n', 0.0) == []
    client.close()


def test_a_second_client_has_a_watch_of_its_own(served):
    first, second = Client(*served), Client(*served)
    assert classes(first.ask()) == ["VERSION"] and classes(second.ask()) == ["VERSION"]
    assert "TPV" in classes(first.ask(b'?WATCH={"enable":true};\n'))
    assert classes(second.ask()) == [], "it did not ask"
    assert classes(second.ask(b"?POLL;\n")) == ["POLL"]
    first.close()
    assert "TPV" in classes(second.ask(b'?WATCH={"enable":true};\n')), "it stays when the first has gone"
    third = Client(*served)
    assert classes(third.ask()) == ["VERSION"]
    second.close()
    third.close()


def test_a_client_that_reads_nothing_holds_nobody_up(served):
    server, step = served
    deaf, awake = Client(server, step), Client(server, step)
    deaf.ask(b'?WATCH={"enable":true};\n', steps=2)
    awake.ask(b'?WATCH={"enable":true};\n', steps=2)
    for _ in range(400):
        step()
    assert "TPV" in classes(awake.ask())
    deaf.close()
    awake.close()


def test_unplugged_lets_everybody_go_and_takes_them_again(served):
    server, step = served
    client = Client(server, step)
    client.ask()
    server.fault(PortFaults(unplugged=True))
    step()
    with pytest.raises(ConnectionError):
        socket.create_connection(("127.0.0.1", server.number), timeout=1.0)
    server.fault(PortFaults())
    step()
    again = Client(server, step)
    assert classes(again.ask()) == ["VERSION"]
    client.close()
    again.close()
