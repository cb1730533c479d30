"""The Calibrate page.

Files:

- `calibration`: What each calibration of the Calibrate screen is made of
- `catch`: The catch test: settle, then catch and weigh, at three settings or more
- `catch_calibration`: The catch test on the screen
- `curve`: Measured points, the line fitted through them
- `effort_calibration`: The reference of effort on the screen
- `guide`: A guided sequence: what is done, what is to be done now, what comes after
- `heads_calibration`: The heads check on the screen
- `keys`: Keys of the Calibrate page and what they do; most are for the calibration that is open
- `lag_calibration`: The lag test on the screen
- `page`: The Calibrate screen: five guided sequences
- `progress_rows`: Rows of a measurement under way
- `service`: What the Calibrate screen can have computed and saved
- `wheel`: The wheel's circumference by GNSS: a straight drive of 100 m or more
- `wheel_calibration`: The wheel's circumference on the screen
"""
