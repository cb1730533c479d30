"""Programs of the boards on the applicator. They run under MicroPython (and, for tests, under
CPython): nothing here imports what a small board does not have, and nothing but the pin layers
touches hardware. See docs/wiring.md.

Files:

- `framing`: Frames of the boards' line protocols
- `lag_rig`: The lag rig's program (lag paper, 1.2)
- `motion`: Motion on the board: shaft speed by PI with feed-forward
- `parts`: Parts at the slave board
- `rp2`: What the main programs of both boards have in common on an RP2040 (Raspberry Pi Pico)
- `rp2_lag_rig`: Main program of the lag rig on an RP2040; copy it to the board as main.py
- `rp2_slave`: Main program of the slave board on an RP2040 (Raspberry Pi Pico)
- `slave`: The slave board's program
"""
