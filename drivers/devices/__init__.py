"""One file a protocol: bytes in, readings out. No decoder opens a port or reads a clock.

Files:

- `agopengps`: Position and speed from AgOpenGPS on the same computer
- `board_frames`: Frames of the slave board's line protocol, version 1, both directions
- `canopy_heads`: Canopy heads that write one ASCII line a sample
- `capture`: Raw captures of one device's line
- `decode`: A raw capture of one device, read through its real driver
- `gnss`: GNSS receivers speaking NMEA 0183: GGA, RMC, VTG
- `gpsd`: gpsd: JSON objects, one a line, over TCP. TPV is a fix, SKY the satellites in it
- `lag_rig`: Host side of the lag rig
- `lag_run`: The lag paper's measuring procedure (section 1.2 and tables 2 to 4)
- `lines`: Bytes that arrive in any pieces, cut into lines; what every decoder of lines has
- `nmea`: One NMEA 0183 sentence: checksum, address, fields
- `point_dose`: Point fertilisation (point-fertilisation paper)
- `probe`: What speaks on a line: its bytes are given to every driver
- `rate_line`: A target from another display
- `rate_module`: Host side of a rate module on UDP, as the drive of the metering shaft
- `rate_module_frames`: Datagrams of the open rate modules
- `slave_board`: Host side of the slave board
- `tractor_speed`: Speeds that the tractor says it will aim at
- `wheel`: Ground speed from wheel pulses and the board's own clock
"""
