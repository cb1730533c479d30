"""Which programs run on the boards of the applicator? They are written for MicroPython (and
CPython, for tests): they import only modules that a small board has, and only the pin layers access
hardware. See docs/wiring.md.

Files:

- `board_sensors`: How are the parts at the slave board read?
- `framing`: How are frames of the boards' line protocols built and read?
- `lag_rig`: How does the lag rig measure response and drop time (lag paper, 1.2)?
- `motion`: How do the drives move? The shaft speed is controlled by PI with feed-forward
- `rp2`: What do the main programs of both boards share on an RP2040 (Raspberry Pi Pico)?
- `rp2_lag_rig`: How does the lag rig run on an RP2040?
- `rp2_slave`: How does the slave board run on an RP2040 (Raspberry Pi Pico)?
- `slave`: How does the slave board move the drives?
"""
