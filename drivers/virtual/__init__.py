"""The virtual machine: the plant of `control.simulation` behind the same bytes that the real
devices speak.

Files:

- `board`: The slave board as the virtual machine has it
- `extras`: What else a virtual machine may be plugged into
- `faults`: A line with something wrong with it
- `gpsd`: gpsd as the virtual machine plays it
- `lag_rig`: A virtual lag rig: the board's own program
- `machine`: The virtual machine
- `served`: The virtual machine served to other programs
"""
