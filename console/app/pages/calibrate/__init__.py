"""The Calibrate page guides through five calibrations of the machine.

Files:

- `calibration`: Defines the base classes of the calibrations on the Calibrate screen
- `catch_calibration`: Guides through the catch test on the screen
- `catch_test`: Records a catch test: settle, then catch and weigh, at three settings or more
- `curve_plot`: Plots measured points, the fitted line
- `effort_calibration`: Guides through the reference of effort
- `guide_panel`: Draws a guided sequence: steps done, the step to do now, later steps
- `heads_calibration`: Guides through the heads check
- `keys`: Defines the keys of the Calibrate page; most belong to the calibration that is open
- `lag_calibration`: Guides through the lag test
- `page`: Shows the Calibrate screen with five guided sequences
- `progress_rows`: Draws the rows of a measurement in progress
- `service`: Declares the computations and files that the Calibrate screen needs
- `wheel_calibration`: Guides through the wheel's calibration
- `wheel_drive`: Records a straight drive of 100 m or more by GNSS and by the wheel
"""
