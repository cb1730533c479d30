"""Serves the worker's end of the link: clients on the loopback interface, in a thread of its own.

Each client receives the newest frame when it is due (`FrameSchedule`); a client that has not read
the last frame misses frames instead of delaying others. Clients with the token may give orders;
other clients are view-only.

Everybody on this computer can connect and send any amount. Clients that have shown the token
therefore come first: they are served as soon as they send something, a bounded number of lines
each. All other clients are served every `UNAUTHORISED_TURN_PERIOD_S`, a few lines each, and their
number is limited. A client that was refused too often is ignored: it is not read any more, so that
it waits, and is then disconnected. Places are reserved for clients with the token; view-only
clients have places of their own, and a client that sends nothing is disconnected.
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

from topdress.console.attached_consoles import DEFAULT_NAME, format_attached_event, make_unique_name
from topdress.console.frame import Frame
from topdress.console.worker import wire_format
from topdress.console.worker.client import Client, ClientKind
from topdress.console.worker.limits import (
    CONSOLE_SILENCE_S,
    FIRST_MESSAGE_TIMEOUT_S,
    IGNORED_CLIENT_S,
    MAX_ACCEPTS_PER_TURN,
    MAX_AUTHORISED_CLIENTS,
    MAX_LINE_BYTES,
    MAX_LINES_PER_TURN,
    MAX_NEW_CLIENTS,
    MAX_UNAUTHORISED_LINES_PER_TURN,
    MAX_VIEWING_CLIENTS,
    MOVING_FRAME_PERIOD_S,
    NEW_CONSOLE_FAST_S,
    STANDING_FRAME_PERIOD_S,
    UNAUTHORISED_READ_BYTES,
    UNAUTHORISED_TURN_PERIOD_S,
    VIEWER_REPORT_DELAY_S,
)
from topdress.console.worker.loop_host import Host
from topdress.console.worker.requests import ClientQuestion, Refusal, Request, parse_request
from topdress.control.orders import Answer, State

# Schedule of frames to the consoles: a discrete change is sent at once, a moving machine often, a
# standing machine rarely.
ACTIVE_STATES = (State.WORKING, State.CALIBRATING)
# Slower speeds, m/s, count as standing, as in the filters of the speed.
MAX_STANDING_SPEED_MPS = 0.05
# Six standard deviations of the nominal encoder's noise, r/min, as in safety.
MAX_STANDING_RPM = 2.0
# A tick that is early by up to this time, s, is the one that is due.
EARLY_TICK_TOLERANCE_S = 0.02


class FrameSchedule:
    """Decides which frames are sent. All consoles share the schedule, so that all receive the same
    frames."""

    def __init__(self) -> None:
        self._sent_s = -inf
        # Discrete fields of the frame that was sent last.
        self._words: Any = None
        # True while a console has come since the last frame; times are those of frames.
        self._comes, self._come_until_s = False, -inf
        # True if the machine moved in the last frame.
        self.moves = True

    def send_next_frame(self) -> None:
        """Make the next frame due, because an order was answered."""
        self._sent_s = -inf

    def greet_console(self) -> None:
        """Make the next frame due for a console that has come; its first frames come as from a
        moving machine."""
        self.send_next_frame()
        self._comes = True

    def is_frame_due(self, frame: Frame) -> bool:
        """Return whether this frame is sent now."""
        words = _list_frame_words(frame)
        if self._comes:
            self._comes, self._come_until_s = False, frame.at_s + NEW_CONSOLE_FAST_S
        self.moves = (
            _is_machine_active(frame) or 0.0 < self._come_until_s - frame.at_s <= NEW_CONSOLE_FAST_S
        )
        wait_s = MOVING_FRAME_PERIOD_S if self.moves else STANDING_FRAME_PERIOD_S
        if (
            words == self._words
            and 0.0 <= frame.at_s - self._sent_s < wait_s - EARLY_TICK_TOLERANCE_S
        ):
            return False
        self._sent_s, self._words = frame.at_s, words
        return True


def _is_machine_active(frame: Frame) -> bool:
    """Return whether the machine works, moves or is tested, so that its numbers are watched."""
    row = frame.row
    return (
        row.state in ACTIVE_STATES
        or frame.lag_test is not None
        or (row.speed_used_mps or 0.0) >= MAX_STANDING_SPEED_MPS
        or (row.shaft_rpm or 0.0) >= MAX_STANDING_RPM
        or any(one.test is not None and one.test.running for one in frame.devices)
    )


def _list_frame_words(frame: Frame) -> tuple[Any, ...]:
    """Return all fields of a frame that are no measured numbers."""
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


# Period of polls for an answer and its frame, s; also while clients without the token are active.
ANSWER_POLL_PERIOD_S = 0.01
# Duration of fast polls after an order, s: its answer, the frame of that tick and the next frames.
FAST_POLL_DURATION_S = 0.3
# Period of polls for a new frame while the machine moves, s: ticks are 0.05 s apart.
MOVING_POLL_PERIOD_S = 0.04
# Period while the machine stands, s, when two frames per second are sent.
STANDING_POLL_PERIOD_S = 0.1
# Period without any client, s.
IDLE_POLL_PERIOD_S = 0.1
# Pause between two turns of a client with the token that sends more than one turn takes, s.
BUSY_CLIENT_PAUSE_S = 0.005

SelectorEvents = list[tuple[selectors.SelectorKey, int]]
CLIENT_PLACES = {
    ClientKind.LOOKING: MAX_VIEWING_CLIENTS,
    ClientKind.WITH_KEY: MAX_AUTHORISED_CLIENTS,
}


class LinkServer(threading.Thread):
    """Serves the clients of one host. `close_link` sends what is queued, then disconnects
    everybody."""

    def __init__(
        self,
        host: Host,
        token: str,
        clock: Callable[[], float] = time.monotonic,
        listener: socket.socket | None = None,
        selector: Callable[[], selectors.BaseSelector] = selectors.DefaultSelector,
    ) -> None:
        super().__init__(name="link", daemon=True)
        # Counts of malformed, oversized, unauthorised and busy requests, dropped frames and more.
        self.counts: Counter[str] = Counter()
        self._host = host
        self._token = token
        self._clock = clock
        # Loopback only: no other computer can reach the worker. Port 0 lets the system choose a
        # free port.
        self._listener = listener or socket.create_server(("127.0.0.1", 0), backlog=MAX_NEW_CLIENTS)
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[Client] = []
        # Sockets of clients that have shown the token.
        self._authorised_selector = selector()
        # The listening socket, and sockets of all other clients.
        self._unauthorised_selector = selector()
        self._unauthorised_selector.register(self._listener, selectors.EVENT_READ)
        self._strangers_due_s = 0.0
        self._answers: deque[tuple[Client, bytes]] = deque()
        self._frame_schedule = FrameSchedule()
        self._seen_seq = -1
        # End of the fast polls for an answer or for the result of an order.
        self._quick_until_s = 0.0
        # True if clients without the token were active in their last turn.
        self._strangers_come = False
        self._closing = threading.Event()

    def run(self) -> None:
        """Serve clients until the end; the thread runs this method."""
        last = False
        while not last:
            # The last round still sends what was queued before `close_link`.
            last = self._closing.is_set()
            self.serve_turn(self._wait_for_authorised())
        for client in self._clients:
            client.connection.close()
        self._authorised_selector.close()
        self._unauthorised_selector.close()
        self._listener.close()

    def serve_turn(self, said: SelectorEvents) -> None:
        """Serve each client once without waiting.

        Parameters
        ----------
        said
            Events of clients with the token.
        """
        self._hear_authorised(said)
        self._send_answers_and_frame()
        if self._clock() >= self._strangers_due_s:
            self._hear_unauthorised()
            self._strangers_due_s = self._clock() + UNAUTHORISED_TURN_PERIOD_S
        self._remove_gone_clients()

    def close_link(self, timeout_s: float = 1.0) -> None:
        """Send what is queued and end the thread within `timeout_s`."""
        self._closing.set()
        if self.is_alive():
            self.join(timeout_s)

    # The following methods choose the client whose turn comes next.

    def _wait_for_authorised(self) -> SelectorEvents:
        """Wait until a client with the token sends something, a frame may exist, or other clients
        have their turn; return the events of clients with the token."""
        holders = [client for client in self._clients if client.kind is ClientKind.WITH_KEY]
        wait_s = MOVING_POLL_PERIOD_S if self._frame_schedule.moves else STANDING_POLL_PERIOD_S
        if self._strangers_come or self._clock() < self._quick_until_s:
            wait_s = ANSWER_POLL_PERIOD_S
        if any(client.has_whole_line for client in holders):
            # The pause gives the interpreter to the control loop.
            self._closing.wait(BUSY_CLIENT_PAUSE_S)
        elif holders:
            return self._authorised_selector.select(wait_s)
        else:
            self._unauthorised_selector.select(wait_s if self._clients else IDLE_POLL_PERIOD_S)
            self._closing.wait(max(0.0, self._strangers_due_s - self._clock()))
        # Windows cannot select from an empty set.
        return self._authorised_selector.select(0.0) if holders else []

    def _hear_authorised(self, said: SelectorEvents) -> None:
        """Serve the clients with the token that have sent something."""
        for client in self._list_ready_clients(said, ClientKind.WITH_KEY):
            self._hear_guarded(client)

    def _hear_unauthorised(self) -> None:
        """Serve all clients without the token for one turn: connected clients first, then new
        connections."""
        said = self._unauthorised_selector.select(0.0)
        self._strangers_come = bool(said)
        for client in self._list_ready_clients(said, ClientKind.NEW, ClientKind.LOOKING):
            self._hear_guarded(client)
        if any(key.data is None for key, _ in said):
            self._accept_connections()
        self._drop_silent_clients()

    def _list_ready_clients(self, said: SelectorEvents, *kinds: ClientKind) -> list[Client]:
        """Return the clients of these kinds that have a line or bytes to read. Nothing waits
        here."""
        new = {id(key.data) for key, _ in said if key.data is not None}
        return [
            client
            for client in self._clients
            if client.kind in kinds
            and client.ignored_since_s is None
            and not client.gone
            and (client.has_whole_line or id(client) in new)
        ]

    # The following methods accept and remove clients.

    def _accept_connections(self) -> None:
        """Accept waiting connections, a bounded number per turn."""
        for _ in range(MAX_ACCEPTS_PER_TURN):
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self._make_room_for_new()
            client = Client(connection, self._clock())
            self._clients.append(client)
            self._unauthorised_selector.register(connection, selectors.EVENT_READ, client)
            client.queue_bytes(wire_format.format_greeting(os.getpid()))

    def _make_room_for_new(self) -> None:
        """Respect the limit of new clients: ignored clients are dropped first, then the oldest that
        still has nothing to say."""
        while (
            len(new := [c for c in self._clients if c.kind is ClientKind.NEW and not c.gone])
            >= MAX_NEW_CLIENTS
        ):
            oldest = next((client for client in new if client.ignored_since_s is not None), new[0])
            if oldest.ignored_since_s is None:
                self._hear_guarded(oldest)
            self._drop_silent_client(oldest)

    def _drop_silent_clients(self) -> None:
        """Disconnect clients that sent nothing in time, and ignored clients after their time."""
        now_s = self._clock()
        for client in self._clients:
            if client.came_s < now_s - FIRST_MESSAGE_TIMEOUT_S:
                self._drop_silent_client(client)
            if (
                client.ignored_since_s is not None
                and client.ignored_since_s < now_s - IGNORED_CLIENT_S
            ):
                client.gone = True

    def _drop_silent_client(self, client: Client) -> None:
        """Disconnect a client that has sent nothing."""
        if client.kind is ClientKind.NEW and not client.gone:
            self.counts["clients_silent"] += 1
            client.gone = True

    def _remove_gone_clients(self) -> None:
        """Remove clients that are gone, and record their departure."""
        for client in [c for c in self._clients if c.gone]:
            self._clients.remove(client)
            for chooser in (self._authorised_selector, self._unauthorised_selector):
                if client.connection in chooser.get_map():
                    chooser.unregister(client.connection)
            client.connection.close()
            if client.shown is not None:
                self._host.note_event(f"left {client.shown.name}")

    # The following methods process requests and send answers and frames.

    def _hear_guarded(self, client: Client) -> None:
        """Serve a client; an exception disconnects this client only."""
        try:
            self._hear_client(client)
        except Exception:
            self.counts["clients_failed"] += 1
            client.gone = True

    def _hear_client(self, client: Client) -> None:
        """Process the lines of a client."""
        with_key = client.kind is ClientKind.WITH_KEY
        lines = client.take_lines(
            MAX_LINES_PER_TURN if with_key else MAX_UNAUTHORISED_LINES_PER_TURN,
            MAX_LINE_BYTES if with_key else UNAUTHORISED_READ_BYTES,
        )
        if client.is_oversized:
            self.counts["oversized"] += 1
            client.gone = True
        for line in lines:
            if client.ignored_since_s is None and not client.gone:
                self._take_line(client, line)

    def _take_line(self, client: Client, line: bytes) -> None:
        """Process one line of a client."""
        request = parse_request(line, self._token) if line.strip() else None
        if isinstance(request, Request) and request.with_key:
            self._take_request(client, request)
        elif (
            # Clients with the token may be refused any number of times.
            not client.refusal_quota.spend_refusal(self._clock())
            and client.kind is not ClientKind.WITH_KEY
        ):
            self._ignore_client(client)
        elif isinstance(request, Request):
            self._take_request(client, request)
        elif isinstance(request, Refusal):
            self.counts[request.kind] += 1
            client.queue_bytes(
                wire_format.format_answer(request.id, Answer(False, request.why), {})
            )

    def _ignore_client(self, client: Client) -> None:
        """Ignore a client from now on: whatever it sends stays in its own buffer."""
        self.counts["clients_put_aside"] += 1
        client.ignored_since_s = self._clock()
        self._unauthorised_selector.unregister(client.connection)
        client.queue_bytes(wire_format.format_answer(None, Answer(False, "refused too often"), {}))

    def _take_request(self, client: Client, request: Request) -> None:
        """Process a valid request."""
        if not self._has_free_place(
            client, ClientKind.WITH_KEY if request.with_key else ClientKind.LOOKING
        ):
            self.counts["clients_refused"] += 1
            client.gone = True
            return
        if request.what is ClientQuestion.ALIVE:
            client.alive_s = self._clock()
            self._host.note_console_heard()
        if request.what is ClientQuestion.LOOK:
            self._name_client(client, request)
        if request.what in (ClientQuestion.ALIVE, ClientQuestion.LOOK):
            client.queue_bytes(
                wire_format.format_answer(
                    request.id, Answer(True), {"name": client.name} if request.name else {}
                )
            )
            return
        self._quick_until_s = self._clock() + FAST_POLL_DURATION_S
        if not self._host.queue_request(
            request.what,
            partial(self._queue_answer, client, request.id, request.what is ClientQuestion.STATS),
            client.name or DEFAULT_NAME,
        ):
            self.counts["busy"] += 1
            client.queue_bytes(wire_format.format_answer(request.id, Answer(False, "busy"), {}))

    def _name_client(self, client: Client, request: Request) -> None:
        """Name a client as it calls itself, but never as another client; a name once shown
        stays."""
        if client.shown is None and not client.name:
            others = {
                other.name for other in self._clients if other is not client and not other.gone
            }
            client.name, client.tablet = (
                make_unique_name(request.name or DEFAULT_NAME, others),
                request.tablet,
            )

    def _has_free_place(self, client: Client, kind: ClientKind) -> bool:
        """Return whether the client has a place of its kind, and assign it."""
        if client.kind in (kind, ClientKind.WITH_KEY):
            return True
        if sum(1 for other in self._clients if other.kind is kind) >= CLIENT_PLACES[kind]:
            return False
        if kind is ClientKind.WITH_KEY:
            self._unauthorised_selector.unregister(client.connection)
            self._authorised_selector.register(client.connection, selectors.EVENT_READ, client)
        client.kind = kind
        # A client that has just come receives the newest frame without waiting.
        self._frame_schedule.greet_console()
        self._seen_seq = -1
        return True

    def _queue_answer(
        self, client: Client, number: int, with_counts: bool, answer: Answer, extra: dict[str, Any]
    ) -> None:
        """Queue an answer. The loop calls this function, so it does nothing else."""
        if with_counts:
            extra = {
                name: part | {"clients": len(self._clients)} | dict(self.counts)
                for name, part in extra.items()
            }
        self._answers.append((client, wire_format.format_answer(number, answer, extra)))

    def _send_answers_and_frame(self) -> None:
        """Send queued answers, and the newest frame if it is due."""
        self._report_attached()
        while self._answers:
            client, data = self._answers.popleft()
            client.queue_bytes(data)
            self._frame_schedule.send_next_frame()
        frame = self._host.newest_frame
        if frame is None or frame.seq == self._seen_seq or not self._clients:
            return
        self._seen_seq = frame.seq
        for client in self._clients:
            if client.is_behind:
                client.send_unsent()
        if self._frame_schedule.is_frame_due(frame):
            self._send_frame(frame)

    def _report_attached(self) -> None:
        """Report attached consoles to the frames; report arrival, silence and return of consoles to
        the log."""
        now_s = self._clock()
        for client in self._clients:
            settled = client.kind is ClientKind.WITH_KEY or (
                client.kind is ClientKind.LOOKING and client.came_s < now_s - VIEWER_REPORT_DELAY_S
            )
            if client.gone or not settled:
                continue
            before, now = client.shown, client.describe_attached(now_s - CONSOLE_SILENCE_S)
            client.shown = now
            if before is None:
                self._host.note_event(format_attached_event(now))
            elif before.keeps and not now.keeps:
                client.has_been_silent = True
                self._host.note_event(f"silent {now.name}")
            elif now.keeps and client.has_been_silent:
                client.has_been_silent = False
                self._host.note_event(f"heard {now.name}")
        self._host.attached = tuple(
            one.shown for one in self._clients if one.shown is not None and not one.gone
        )

    def _send_frame(self, frame: Frame) -> None:
        """Send a frame to every client that has read the former frame."""
        try:
            data = wire_format.format_frame(frame)
        except (ValueError, TypeError):
            self.counts["frames_not_finite"] += 1
            return
        for client in self._clients:
            if client.kind is ClientKind.NEW or client.ignored_since_s is not None:
                continue
            if client.is_behind:
                self.counts["dropped_frames"] += 1
            else:
                client.queue_bytes(data)
