"""How does a simulated machine speak like a real one? The plant of `control.simulation` behind
the same bytes as the real devices.

Files:

- `board`: How does the virtual machine's slave board behave?
- `extras`: What else can be connected to a virtual machine?
- `faults`: Which faults can a line or a drive have?
- `gpsd`: How does the virtual machine imitate gpsd?
- `lag_rig`: How does a virtual lag rig work?
- `machine`: How is a plant reached through ports and bytes only, as real devices would write them?
- `served`: How is the virtual machine served to other programs?
"""
