"""How does a simulated machine communicate like a real machine? The plant of `control.simulation`
sends and receives the same bytes as the real devices.

Files:

- `board`: How does the virtual machine's slave board behave?
- `faults`: Which faults can a line or a drive have?
- `gpsd`: How does the virtual machine imitate gpsd?
- `lag_rig`: How does a virtual lag rig work?
- `machine`: How is a plant reached through ports and bytes only?
- `served_machine`: How is the virtual machine served to other programs?
- `virtual_devices`: Which devices can be connected to a virtual machine besides receiver
"""
