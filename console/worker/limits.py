"""Declares every limit of the control worker. (`SafetyLimits` has the time after which a silent
console means hold.)
"""

from __future__ import annotations

# Without an operating console for this time, s, the worker switches off, closes the log and exits.
ORPHAN_S = 60.0
# Control ticks per second.
HZ_DEFAULT = 20.0
# Slower ticks could not follow the machine.
HZ_LOWEST = 1.0
# Faster ticks exceed what small computers finish in time.
HZ_HIGHEST = 100.0
# Frames made per second, at most.
FRAME_HZ = 20.0
# Period of frames to each client while the machine moves, s; discrete changes are sent at once.
MOVES_S = 0.1
# Period while the machine stands, s: the console reports missing data after 1 s without a frame.
STANDS_S = 0.5
# For this time, s, after a console has attached, frames come as from a moving machine, so that it
# is visibly alive at once.
COMES_S = 2.0
# Period of the list of devices in frames, s.
DEVICES_S = 0.2
# A capture ends by itself at this size, bytes: about a day of a receiver at 10 Hz.
CAPTURE_BYTES = 100_000_000
# Time for which a device is listened to before its protocol is determined, s.
TEST_S = 1.5
# Period of the totals in frames, s.
TOTALS_S = 1.0
# Beyond this delay, in periods, missed ticks are skipped instead of run in a burst.
CATCH_UP_PERIODS = 5
# Requests answered in one tick, at most: bounds the cost of clients for the loop.
REQUESTS_A_TICK = 16
# Further requests are refused at once.
REQUESTS_WAITING = 256
# A client that sends more bytes without an end of line is disconnected.
LINE_BYTES = 65_536
# A client that leaves more bytes of answers unread is disconnected.
UNREAD_BYTES = 262_144
# Clients that have shown the token: their places cannot be taken by others.
CLIENTS_WITH_KEY = 8
# Clients that declared themselves as view-only.
CLIENTS_LOOKING = 8
# Clients that have sent nothing valid yet; another such client replaces the oldest.
CLIENTS_NEW = 64
# Lines per turn of a client with the token: some 2 ms of the worker's time.
LINES_A_TURN = 64
# Lines per turn of any other client: all of them together cost at most 3 ms per turn.
LINES_A_TURN_WITHOUT_KEY = 2
# Bytes read at once from a client without the token, whose messages are short.
READ_BYTES_WITHOUT_KEY = 4_096
# Period at which clients without the token, and new connections, are served, s: bounds the cost of
# a flood.
STRANGERS_S = 0.02
# Connections accepted per turn: 200 per second, so that a new client has 0.3 s to show its token.
ACCEPTS_A_TURN = 4
# A client without the token is ignored after this number of refusals.
REFUSALS = 8
# A further refusal is permitted after each such time, s.
REFUSAL_AGAIN_S = 1.0
# An ignored client is disconnected after this time, s; at once it would only return sooner.
ASIDE_S = 2.0
# A console that is silent for this time, s, does not keep the machine working; the same limit as in
# safety.
CONSOLE_S = 2.0
# A view-only client is reported to others and to the log after this time, s, so that repeated
# connections do not fill the log.
LOOKER_STAYS_S = 0.5
# A client that sends nothing valid for this time, s, is disconnected.
HELLO_S = 2.0
# Time for which a worker waits for another worker that is about to end, s.
LOCK_S = 2.0
# Send buffer of each socket, bytes: bounds the age of the frames that a stalled client finds.
SEND_BUFFER_BYTES = 16_384
# Longest text in an order.
TEXT_CHARACTERS = 1_000
# Different failures that are printed to stderr; repetitions are not printed.
REPORTED_KINDS = 100
# Time for which a truncated log is reported, s.
SAID_S = 60.0
