"""The worker's end of the link: clients on loopback, in a thread of its own.

Each client gets the newest frame when it is due (`FrameSchedule`); a client that has not taken the
last one yet misses frames rather than being waited for. Clients that hold the token may order;
the others look.

Everybody on this computer can connect, and send as much as he likes. So whoever has shown the
token comes first: those are heard the moment they say something, a bounded number of lines
each. All others take turns `STRANGERS_S` apart, a few lines each, and so many of them are let
in and no more. Who was refused too often is put aside: he is not read any more, so that he
waits for us, and is then disconnected. Places are kept for those who have shown the token;
those who only look have places of their own, and who says nothing is disconnected.
"""

from __future__ import annotations

import os
import selectors
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from math import inf
from typing import Any

from topdress.console.attached import UNNAMED, format_attached_event, make_unique_name
from topdress.console.frame import Frame
from topdress.console.worker import wire
from topdress.console.worker.client import Client, ClientKind
from topdress.console.worker.host import Host
from topdress.console.worker.limits import (
    ACCEPTS_A_TURN,
    ASIDE_S,
    CLIENTS_LOOKING,
    CLIENTS_NEW,
    CLIENTS_WITH_KEY,
    COMES_S,
    CONSOLE_S,
    HELLO_S,
    LINE_BYTES,
    LINES_A_TURN,
    LINES_A_TURN_WITHOUT_KEY,
    LOOKER_STAYS_S,
    MOVES_S,
    READ_BYTES_WITHOUT_KEY,
    STANDS_S,
    STRANGERS_S,
)
from topdress.console.worker.requests import Question, Refusal, Request, parse_request
from topdress.control.orders import Answer, State

# When a frame is reported to the consoles: what changed at once, a machine that moves often,
# one that stands seldom.
WORK_STATES = (State.WORKING, State.CALIBRATING)
# slower: standing, as the filters of the speed have it
STANDS_MPS = 0.05
# six s.d. of the nominal encoder's noise, as safety has it
STANDS_RPM = 2.0
# a tick that comes a little sooner than it should is the one that is due
HALF_A_TICK_S = 0.02


class FrameSchedule:
    """Decides which frames are sent. One schedule for all consoles: what one gets all get."""

    def __init__(self) -> None:
        self._sent_s = -inf
        self._words: Any = None  # of the frame reported last
        # since the frame looked at last; by the clock of frames
        self._comes, self._come_until_s = False, -inf
        self.moves = True  # by the frame looked at last

    def send_next_frame(self) -> None:
        """Make the next frame due: an order was answered."""
        self._sent_s = -inf

    def greet_console(self) -> None:
        """Make the next frame due for a console that came; its first numbers move at once, as those
        of a machine at work."""
        self.send_next_frame()
        self._comes = True

    def is_frame_due(self, frame: Frame) -> bool:
        """Whether this frame is to be sent now."""
        words = _list_frame_words(frame)
        if self._comes:
            self._comes, self._come_until_s = False, frame.at_s + COMES_S
        self.moves = _is_machine_active(frame) or 0.0 < self._come_until_s - frame.at_s <= COMES_S
        wait_s = MOVES_S if self.moves else STANDS_S
        if words == self._words and 0.0 <= frame.at_s - self._sent_s < wait_s - HALF_A_TICK_S:
            return False
        self._sent_s, self._words = frame.at_s, words
        return True


def _is_machine_active(frame: Frame) -> bool:
    """Whether the machine works, moves or is tested, so that its numbers are watched."""
    row = frame.row
    return (
        row.state in WORK_STATES
        or frame.lag_test is not None
        or (row.speed_used_mps or 0.0) >= STANDS_MPS
        or (row.shaft_rpm or 0.0) >= STANDS_RPM
        or any(one.test is not None and one.test.running for one in frame.devices)
    )


def _list_frame_words(frame: Frame) -> tuple[Any, ...]:
    """All fields of a frame that are no measured number."""
    row = frame.row
    return (
        row.state,
        row.strategy,
        row.target_source,
        row.nudge_percent,
        row.work_switch,
        row.events,
        row.fix_quality,
        frame.alarms,
        frame.why_no_flow,
        frame.why_state,
        frame.allow,
        frame.notes,
        frame.dropped_heads,
        frame.look_ahead,
        frame.flow_trim_on,
        frame.no_double,
        frame.sections,
        frame.strips,
        frame.bench is None,
        frame.lag_test,
        None if frame.tally is None else frame.tally._replace(held_s=0.0),
        frame.consoles,
        frame.attached,
        frame.ordered,
        frame.job,
        frame.machine,
        frame.crop,
        frame.log_path,
        [
            (
                one.name,
                one.connected,
                one.plugged,
                one.protocol,
                one.last_error,
                one.capture_path,
                one.test,
            )
            for one in frame.devices
        ],
    )


# how often an answer, and the frame after it, is looked for; and while strangers come
LOOK_S = 0.01
# for so long after an order: its answer, the frame of that tick and of the next ones
QUICK_S = 0.3
# how often a new frame is looked for while it moves: ticks are 0.05 s apart
REST_S = 0.04
# and while the machine stands, of which two frames a second are reported
STILL_S = 0.1
IDLE_S = 0.1  # and while nobody is
# between two turns of a holder of the token who says more than a turn takes
PAUSE_S = 0.005

SelectorEvents = list[tuple[selectors.SelectorKey, int]]
CLIENT_PLACES = {ClientKind.LOOKING: CLIENTS_LOOKING, ClientKind.WITH_KEY: CLIENTS_WITH_KEY}


class LinkServer(threading.Thread):
    """Serves the clients of one host. `close_link` sends what is still waiting, then disconnects
    everybody."""

    def __init__(self, host: Host, token: str, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(name="link", daemon=True)
        # malformed, oversized, unauthorised, busy, dropped_frames, ...
        self.counts: Counter[str] = Counter()
        self._host = host
        self._token = token
        self._clock = clock
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=CLIENTS_NEW)
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[Client] = []
        # sockets of those who have shown the token
        self._holders = selectors.DefaultSelector()
        self._strangers = selectors.DefaultSelector()  # the listener, and all others
        self._strangers.register(self._listener, selectors.EVENT_READ)
        self._strangers_due_s = 0.0
        self._answers: deque[tuple[Client, bytes]] = deque()
        self._telling = FrameSchedule()
        self._seen_seq = -1
        # an answer, or what comes of an order, is waited for
        self._quick_until_s = 0.0
        self._strangers_come = False  # at their last turn
        self._closing = threading.Event()

    def run(self) -> None:
        last = False
        while not last:
            last = self._closing.is_set()  # what was queued before `close` still goes out
            self._hear_holders(self._wait_for_holders())
            self._send_answers_and_frame()
            if self._clock() >= self._strangers_due_s:
                self._hear_strangers()
                self._strangers_due_s = self._clock() + STRANGERS_S
            self._remove_gone_clients()
        for client in self._clients:
            client.connection.close()
        self._holders.close()
        self._strangers.close()
        self._listener.close()

    def close_link(self, timeout_s: float = 1.0) -> None:
        """Send what is queued and end the thread within `timeout_s`."""
        self._closing.set()
        if self.is_alive():
            self.join(timeout_s)

    # --- whose turn it is
    # --------------------------------------------------------------------------------------------

    def _wait_for_holders(self) -> SelectorEvents:
        """Wait until a holder of the token says something, a frame may be there, or strangers have
        their turn; returns the holders' events."""
        holders = [client for client in self._clients if client.kind is ClientKind.WITH_KEY]
        wait_s = REST_S if self._telling.moves else STILL_S
        if self._strangers_come or self._clock() < self._quick_until_s:
            wait_s = LOOK_S
        if any(client.has_whole_line for client in holders):
            self._closing.wait(PAUSE_S)  # the loop needs the interpreter too
        elif holders:
            return self._holders.select(wait_s)
        else:
            self._strangers.select(wait_s if self._clients else IDLE_S)
            self._closing.wait(max(0.0, self._strangers_due_s - self._clock()))
        # Windows cannot choose from nothing
        return self._holders.select(0.0) if holders else []

    def _hear_holders(self, said: SelectorEvents) -> None:
        for client in self._list_ready_clients(said, ClientKind.WITH_KEY):
            self._hear_guarded(client)

    def _hear_strangers(self) -> None:
        """Take one turn of all who have not shown the token: connected ones first, then new
        ones."""
        said = self._strangers.select(0.0)
        self._strangers_come = bool(said)
        for client in self._list_ready_clients(said, ClientKind.NEW, ClientKind.LOOKING):
            self._hear_guarded(client)
        if any(key.data is None for key, _ in said):
            self._accept_connections()
        self._drop_silent_clients()

    def _list_ready_clients(self, said: SelectorEvents, *kinds: ClientKind) -> list[Client]:
        """Clients of these kinds that have something to be heard. Nothing waits here."""
        new = {id(key.data) for key, _ in said if key.data is not None}
        return [
            client
            for client in self._clients
            if client.kind in kinds
            and client.aside_s is None
            and not client.gone
            and (client.has_whole_line or id(client) in new)
        ]

    # --- coming and going
    # --------------------------------------------------------------------------------------------

    def _accept_connections(self) -> None:
        """Accept those who wait to be let in, a bounded number in one turn."""
        for _ in range(ACCEPTS_A_TURN):
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self._make_room_for_new()
            client = Client(connection, self._clock())
            self._clients.append(client)
            self._strangers.register(connection, selectors.EVENT_READ, client)
            client.queue_bytes(wire.format_greeting(os.getpid()))

    def _make_room_for_new(self) -> None:
        """Keep to the number of new clients allowed: first those put aside are dropped, then the
        oldest that still has nothing to say."""
        while (
            len(new := [c for c in self._clients if c.kind is ClientKind.NEW and not c.gone])
            >= CLIENTS_NEW
        ):
            oldest = next((client for client in new if client.aside_s is not None), new[0])
            if oldest.aside_s is None:
                self._hear_guarded(oldest)
            self._drop_silent_client(oldest)

    def _drop_silent_clients(self) -> None:
        now_s = self._clock()
        for client in self._clients:
            if client.came_s < now_s - HELLO_S:
                self._drop_silent_client(client)
            if client.aside_s is not None and client.aside_s < now_s - ASIDE_S:
                client.gone = True

    def _drop_silent_client(self, client: Client) -> None:
        if client.kind is ClientKind.NEW and not client.gone:
            self.counts["clients_silent"] += 1
            client.gone = True

    def _remove_gone_clients(self) -> None:
        for client in [c for c in self._clients if c.gone]:
            self._clients.remove(client)
            for chooser in (self._holders, self._strangers):
                if client.connection in chooser.get_map():
                    chooser.unregister(client.connection)
            client.connection.close()
            if client.shown is not None:
                self._host.note_event(f"left {client.shown.name}")

    # --- what is said
    # ----------------------------------------------------------------------------------------------

    def _hear_guarded(self, client: Client) -> None:
        """Hear a client; one whose lines raise is disconnected, nobody else."""
        try:
            self._hear_client(client)
        except Exception:
            self.counts["clients_failed"] += 1
            client.gone = True

    def _hear_client(self, client: Client) -> None:
        with_key = client.kind is ClientKind.WITH_KEY
        lines = client.take_lines(
            LINES_A_TURN if with_key else LINES_A_TURN_WITHOUT_KEY,
            LINE_BYTES if with_key else READ_BYTES_WITHOUT_KEY,
        )
        if client.is_oversized:
            self.counts["oversized"] += 1
            client.gone = True
        for line in lines:
            if client.aside_s is None and not client.gone:
                self._take_line(client, line)

    def _take_line(self, client: Client, line: bytes) -> None:
        request = parse_request(line, self._token) if line.strip() else None
        if isinstance(request, Request) and request.with_key:
            self._take_request(client, request)
        elif (
            not client.patience.spend_refusal(self._clock())
            and client.kind is not ClientKind.WITH_KEY
        ):
            self._put_client_aside(client)
        elif isinstance(request, Request):
            self._take_request(client, request)
        elif isinstance(request, Refusal):
            self.counts[request.kind] += 1
            client.queue_bytes(wire.format_answer(request.id, Answer(False, request.why), {}))

    def _put_client_aside(self, client: Client) -> None:
        """Neither hear nor watch this client any more: what else it sends stays in its own
        buffer."""
        self.counts["clients_put_aside"] += 1
        client.aside_s = self._clock()
        self._strangers.unregister(client.connection)
        client.queue_bytes(wire.format_answer(None, Answer(False, "refused too often"), {}))

    def _take_request(self, client: Client, request: Request) -> None:
        if not self._has_free_place(
            client, ClientKind.WITH_KEY if request.with_key else ClientKind.LOOKING
        ):
            self.counts["clients_refused"] += 1
            client.gone = True
            return
        if request.what is Question.ALIVE:
            client.alive_s = self._clock()
            self._host.note_console_heard()
        if request.what is Question.LOOK:
            self._name_client(client, request)
        if request.what in (Question.ALIVE, Question.LOOK):
            client.queue_bytes(
                wire.format_answer(
                    request.id, Answer(True), {"name": client.name} if request.name else {}
                )
            )
            return
        self._quick_until_s = self._clock() + QUICK_S
        if not self._host.queue_request(
            request.what,
            partial(self._queue_answer, client, request.id, request.what is Question.STATS),
            client.name or UNNAMED,
        ):
            self.counts["busy"] += 1
            client.queue_bytes(wire.format_answer(request.id, Answer(False, "busy"), {}))

    def _name_client(self, client: Client, request: Request) -> None:
        """Name a client as it calls itself, but never as somebody else; a name once shown stays."""
        if client.shown is None and not client.name:
            others = {
                other.name for other in self._clients if other is not client and not other.gone
            }
            client.name, client.tablet = (
                make_unique_name(request.name or UNNAMED, others),
                request.tablet,
            )

    def _has_free_place(self, client: Client, kind: ClientKind) -> bool:
        if client.kind in (kind, ClientKind.WITH_KEY):
            return True
        if sum(1 for other in self._clients if other.kind is kind) >= CLIENT_PLACES[kind]:
            return False
        if kind is ClientKind.WITH_KEY:
            self._strangers.unregister(client.connection)
            self._holders.register(client.connection, selectors.EVENT_READ, client)
        client.kind = kind
        # who comes waits for no frame: it gets the newest
        self._telling.greet_console()
        self._seen_seq = -1
        return True

    def _queue_answer(
        self, client: Client, number: int, with_counts: bool, answer: Answer, extra: dict[str, Any]
    ) -> None:
        """Queue an answer; called by the loop, so nothing else."""
        if with_counts:
            extra = {
                name: part | {"clients": len(self._clients)} | dict(self.counts)
                for name, part in extra.items()
            }
        self._answers.append((client, wire.format_answer(number, answer, extra)))

    def _send_answers_and_frame(self) -> None:
        self._report_attached()
        while self._answers:
            client, data = self._answers.popleft()
            client.queue_bytes(data)
            self._telling.send_next_frame()
        frame = self._host.newest
        if frame is None or frame.seq == self._seen_seq or not self._clients:
            return
        self._seen_seq = frame.seq
        for client in self._clients:
            if client.is_behind:
                client.send_unsent()
        if self._telling.is_frame_due(frame):
            self._send_frame(frame)

    def _report_attached(self) -> None:
        """Report who is attached to the frames, and who comes, falls silent or is heard again to
        the log."""
        now_s = self._clock()
        for client in self._clients:
            settled = client.kind is ClientKind.WITH_KEY or (
                client.kind is ClientKind.LOOKING and client.came_s < now_s - LOOKER_STAYS_S
            )
            if client.gone or not settled:
                continue
            before, now = client.shown, client.describe_attached(now_s - CONSOLE_S)
            client.shown = now
            if before is None:
                self._host.note_event(format_attached_event(now))
            elif before.keeps and not now.keeps:
                client.was_silent = True
                self._host.note_event(f"silent {now.name}")
            elif now.keeps and client.was_silent:
                client.was_silent = False
                self._host.note_event(f"heard {now.name}")
        self._host.attached = tuple(
            one.shown for one in self._clients if one.shown is not None and not one.gone
        )

    def _send_frame(self, frame: Frame) -> None:
        try:
            data = wire.format_frame(frame)
        except (ValueError, TypeError):
            self.counts["frames_not_finite"] += 1
            return
        for client in self._clients:
            if client.kind is ClientKind.NEW or client.aside_s is not None:
                continue
            if client.is_behind:
                self.counts["dropped_frames"] += 1
            else:
                client.queue_bytes(data)
