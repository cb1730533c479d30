"""What is decided and modelled. Pure: no I/O, no clock, no thread, no screen."""
