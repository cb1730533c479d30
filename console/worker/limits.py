"""Declares every limit of the control worker. (`SafetyLimits` has the time after which a silent
console means hold.)
"""

from __future__ import annotations

# Without an operating console for this time, s, the worker switches off, closes the log and exits.
ORPHAN_TIMEOUT_S = 60.0
# Control ticks per second.
DEFAULT_TICK_HZ = 20.0
# Slower ticks could not follow the machine.
MIN_TICK_HZ = 1.0
# Faster ticks exceed what small computers finish in time.
MAX_TICK_HZ = 100.0
# Frames made per second, at most.
MAX_FRAME_HZ = 20.0
# Period of frames to each client while the machine moves, s; discrete changes are sent at once.
MOVING_FRAME_PERIOD_S = 0.1
# Period while the machine stands, s: the console reports missing data after 1 s without a frame.
STANDING_FRAME_PERIOD_S = 0.5
# For this time, s, after a console has attached, frames come as from a moving machine, so that it
# is visibly alive at once.
NEW_CONSOLE_FAST_S = 2.0
# Period of the list of devices in frames, s.
DEVICE_LIST_PERIOD_S = 0.2
# A capture ends by itself at this size, bytes: about a day of a receiver at 10 Hz.
MAX_CAPTURE_BYTES = 100_000_000
# Time for which a device is listened to before its protocol is determined, s.
LISTEN_TEST_DURATION_S = 1.5
# Period of the totals in frames, s.
TOTALS_PERIOD_S = 1.0
# Beyond this delay, in periods, missed ticks are skipped instead of run in a burst.
MAX_CATCH_UP_PERIODS = 5
# Requests answered in one tick, at most: bounds the cost of clients for the loop.
MAX_REQUESTS_PER_TICK = 16
# Further requests are refused at once.
MAX_WAITING_REQUESTS = 256
# A client that sends more bytes without an end of line is disconnected.
MAX_LINE_BYTES = 65_536
# A client that leaves more bytes of answers unread is disconnected.
MAX_UNREAD_BYTES = 262_144
# Clients that have shown the token: their places cannot be taken by others.
MAX_AUTHORISED_CLIENTS = 8
# Clients that declared themselves as view-only.
MAX_VIEWING_CLIENTS = 8
# Clients that have sent nothing valid yet; another such client replaces the oldest.
MAX_NEW_CLIENTS = 64
# Lines per turn of a client with the token: some 2 ms of the worker's time.
MAX_LINES_PER_TURN = 64
# Lines per turn of any other client: all of them together cost at most 3 ms per turn.
MAX_UNAUTHORISED_LINES_PER_TURN = 2
# Bytes read at once from a client without the token, whose messages are short.
UNAUTHORISED_READ_BYTES = 4_096
# Period at which clients without the token, and new connections, are served, s: bounds the cost of
# a flood.
UNAUTHORISED_TURN_PERIOD_S = 0.02
# Connections accepted per turn: 200 per second, so that a new client has 0.3 s to show its token.
MAX_ACCEPTS_PER_TURN = 4
# A client without the token is ignored after this number of refusals.
MAX_CLIENT_REFUSALS = 8
# A further refusal is permitted after each such time, s.
REFUSAL_RECOVERY_S = 1.0
# An ignored client is disconnected after this time, s; at once it would only return sooner.
IGNORED_CLIENT_S = 2.0
# A console that is silent for this time, s, does not keep the machine working; the same limit as in
# safety.
CONSOLE_SILENCE_S = 2.0
# A view-only client is reported to others and to the log after this time, s, so that repeated
# connections do not fill the log.
VIEWER_REPORT_DELAY_S = 0.5
# A client that sends nothing valid for this time, s, is disconnected.
FIRST_MESSAGE_TIMEOUT_S = 2.0
# Time for which a worker waits for another worker that is about to end, s.
LOCK_TIMEOUT_S = 2.0
# Send buffer of each socket, bytes: bounds the age of the frames that a stalled client finds.
SEND_BUFFER_BYTES = 16_384
# Longest text in an order.
MAX_TEXT_CHARACTERS = 1_000
# Different failures that are printed to stderr; repetitions are not printed.
MAX_REPORTED_FAILURES = 100
# Time for which a truncated log is reported, s.
LOG_CUT_NOTICE_S = 60.0
