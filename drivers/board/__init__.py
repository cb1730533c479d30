"""Programs of the boards on the applicator. They run under MicroPython (and, for tests, under
CPython): nothing here imports what a small board does not have, and nothing but the pin layers
touches hardware. See docs/wiring.md."""
