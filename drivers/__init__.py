"""What is connected to the program? Ports, devices, the virtual machine, files.

Files:

- `board`: What runs on the boards of the applicator?
- `cab`: Which devices does one machine have, and what do they read and obey in a tick?
- `cab_config`: Which devices does a machine have, and where are they connected?
- `cab_line`: How is one device's line in the cab managed?
- `datagrams`: How are datagrams sent and received over UDP?
- `day_clock`: Which day is it by the computer's clock?
- `device_status`: What is known of one device in the cab?
- `devices`: How are the bytes of a device decoded?
- `files`: Which files does topdress read and write
- `plain_text`: Which characters of foreign text may a terminal see?
- `plugin_host`: How does the code of a plug-in run in its own process?
- `plugin_process`: How is the code of a plug-in called safely?
- `plugins`: What do other packages add to topdress by entry points (CONTRIBUTING.md, "Plug-ins")?
- `ports`: How do bytes reach a device and come back without blocking the control loop?
- `virtual`: How does a simulated machine speak like a real one?
"""
