"""What runs on the boards of the applicator? Programs for MicroPython (and, for tests, CPython):
they import only what a small board has, and only the pin layers touch hardware. See
docs/wiring.md.

Files:

- `framing`: How are frames of the boards' line protocols built and read?
- `lag_rig`: How does the lag rig measure response and drop time (lag paper, 1.2)?
- `motion`: How do the drives move? Shaft speed by PI with feed-forward
- `parts`: How are the parts at the slave board read?
- `rp2`: What do the main programs of both boards share on an RP2040 (Raspberry Pi Pico)?
- `rp2_lag_rig`: Main program of the lag rig on an RP2040; copy it to the board as main.py
- `rp2_slave`: Main program of the slave board on an RP2040 (Raspberry Pi Pico)
- `slave`: The slave board's program
"""
