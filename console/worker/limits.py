"""Every limit of the control worker, in one place. (That a silent console means `hold_right` is
safety's: SafetyLimits.)"""

from __future__ import annotations

# no operating console heard for that long: off, log closed, exit
ORPHAN_S = 60.0
HZ_DEFAULT = 20.0  # control ticks a second
HZ_LOWEST = 1.0
HZ_HIGHEST = 100.0
FRAME_HZ = 20.0  # frames made a second, at most
# reported to each client that often while the machine moves, and what changes at once
MOVES_S = 0.1
# while it stands: the console says after 1 s without a frame that there is no data
STANDS_S = 0.5
# after a console came it is reported as while it moves: that it lives is seen at once
COMES_S = 2.0
DEVICES_S = 0.2  # and the list of devices
# a capture ends by itself at that size: about a day of a receiver at 10 Hz
CAPTURE_BYTES = 100_000_000
# a device is listened to for that long before it is said what speaks there
TEST_S = 1.5
TOTALS_S = 1.0  # totals are made anew this often
# further behind than this, missed ticks are skipped rather than run in a burst
CATCH_UP_PERIODS = 5
# requests answered in one tick, at most: bounds what clients can cost the loop
REQUESTS_A_TICK = 16
REQUESTS_WAITING = 256  # more than this waiting: refused at once
# a client that sends more without an end of line is disconnected
LINE_BYTES = 65_536
# a client that leaves more answers unread is disconnected
UNREAD_BYTES = 262_144
# clients at once that have shown the token: nobody else can take their places
CLIENTS_WITH_KEY = 8
CLIENTS_LOOKING = 8  # and that said that they only look
# and that said nothing yet: one more closes the oldest of them
CLIENTS_NEW = 64
# of a client that has shown the token: some 2 ms of the worker's time
LINES_A_TURN = 64
# of any other: all of them together cost 3 ms a turn at most
LINES_A_TURN_WITHOUT_KEY = 2
# read of it at once: what it has to say is shorter
READ_BYTES_WITHOUT_KEY = 4_096
# such clients, and those who come, have their turn that often: bounds what a flood costs
STRANGERS_S = 0.02
# let in at each turn: 200 a second, so a new one has 0.3 s to show its token
ACCEPTS_A_TURN = 4
# a client without the token that was refused that often is put aside ...
REFUSALS = 8
REFUSAL_AGAIN_S = 1.0  # ... one more is forgiven every second
# and then disconnected; at once it would only come back sooner
ASIDE_S = 2.0
# a console that said nothing for that long keeps nothing working, as safety has it
CONSOLE_S = 2.0
# who only looks is named to the others, and in the log, once there for that long: coming and
# going without the token fills no log
LOOKER_STAYS_S = 0.5
HELLO_S = 2.0  # who said nothing for that long is disconnected
# a worker waits that long for one that is about to end
LOCK_S = 2.0
# of each socket: bounds how old the frames are that a stalled client finds
SEND_BUFFER_BYTES = 16_384
TEXT_CHARACTERS = 1_000  # longest text in an order
# different failures that stderr hears of; the same again is not reported
REPORTED_KINDS = 100
SAID_S = 60.0  # that the log was cut short is said for so long
