"""Every limit of the control worker, in one place. (That a silent console means `held` is safety's: SafetyLimits.)"""
from __future__ import annotations

ORPHAN_S = 60.0              # no operating console heard for that long: off, log closed, exit
HZ_DEFAULT = 20.0            # control ticks a second
HZ_LOWEST = 1.0
HZ_HIGHEST = 100.0
FRAME_HZ = 20.0              # frames made a second, at most
MOVES_S = 0.1                # reported to each client that often while the machine moves, and what changes at once
STANDS_S = 0.5               # while it stands: the console says after 1 s without a frame that there is no data
COMES_S = 2.0                # after a console came it is reported as while it moves: that it lives is seen at once
DEVICES_S = 0.2              # and the list of devices
CAPTURE_BYTES = 100_000_000  # a capture ends by itself at that size: about a day of a receiver at 10 Hz
TEST_S = 1.5                 # a device is listened to for that long before it is said what speaks there
TOTALS_S = 1.0               # totals are made anew this often
CATCH_UP_PERIODS = 5         # further behind than this, missed ticks are skipped rather than run in a burst
REQUESTS_A_TICK = 16         # requests answered in one tick, at most: bounds what clients can cost the loop
REQUESTS_WAITING = 256       # more than this waiting: refused at once
LINE_BYTES = 65_536          # a client that sends more without an end of line is disconnected
UNREAD_BYTES = 262_144       # a client that leaves more answers unread is disconnected
CLIENTS_WITH_KEY = 8         # clients at once that have shown the token: nobody else can take their places
CLIENTS_LOOKING = 8          # and that said that they only look
CLIENTS_NEW = 64             # and that said nothing yet: one more closes the oldest of them
LINES_A_TURN = 64            # of a client that has shown the token: some 2 ms of the worker's time
LINES_A_TURN_WITHOUT_KEY = 2                # of any other: all of them together cost 3 ms a turn at most
READ_BYTES_WITHOUT_KEY = 4_096              # read of it at once: what it has to say is shorter
STRANGERS_S = 0.02           # such clients, and those who come, have their turn that often: bounds what a flood costs
ACCEPTS_A_TURN = 4           # let in at each turn: 200 a second, so a new one has 0.3 s to show its token
REFUSALS = 8                 # a client without the token that was refused that often is put aside ...
REFUSAL_AGAIN_S = 1.0        # ... one more is forgiven every second
ASIDE_S = 2.0                # and then disconnected; at once it would only come back sooner
CONSOLE_S = 2.0              # a console that said nothing for that long keeps nothing working, as safety has it
LOOKER_STAYS_S = 0.5         # who only looks is named to the others, and in the log, once there for that long: coming
                             # and going without the token fills no log
HELLO_S = 2.0                # who said nothing for that long is disconnected
LOCK_S = 2.0                 # a worker waits that long for one that is about to end
SEND_BUFFER_BYTES = 16_384   # of each socket: bounds how old the frames are that a stalled client finds
TEXT_CHARACTERS = 1_000      # longest text in an order
REPORTED_KINDS = 100             # different failures that stderr hears of; the same again is not reported
SAID_S = 60.0               # that the log was cut short is said for so long
