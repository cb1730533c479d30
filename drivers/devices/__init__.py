"""How are the bytes of a device decoded? Each protocol has one file that turns bytes into readings.
No decoder opens a port or reads a clock.

Files:

- `agopengps`: How are position and speed of AgOpenGPS decoded?
- `board_frames`: How are frames of the slave board's line protocol, version 1
- `canopy_heads`: How are the lines of canopy heads decoded?
- `capture`: How are the raw bytes of one device's line recorded, with times?
- `decode`: What does a raw capture of one device contain, read through its real driver?
- `device`: What does a device state about itself?
- `fix_source`: Which receiver or program gives the position?
- `gnss`: How are the NMEA 0183 sentences of GNSS receivers decoded to fixes?
- `gpsd`: How are the JSON objects of gpsd decoded?
- `lag_rig`: How are the lag rig's lines decoded and its orders encoded?
- `lag_run`: How are response and drop time measured over shaft speed?
- `lines`: How are bytes that arrive in any pieces cut into lines, and how are faults counted?
- `nmea`: How is one NMEA 0183 sentence read?
- `point_dose`: How is the dose for one plant ordered (point-fertilisation paper)?
- `protocol_probe`: Which device speaks on a line?
- `rate_line`: Which target does another display send, and which rate does another controller apply?
- `rate_module`: How does the host drive the metering shaft through a rate module on UDP?
- `rate_module_frames`: How are datagrams of the open rate modules encoded and decoded?
- `registry`: Which devices are there?
- `slave_board`: How does the host talk to the slave board?
- `tractor_speed`: Which speeds does the tractor announce?
- `wheel`: How fast does the wheel turn?
"""
