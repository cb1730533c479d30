"""What is connected to the program? Ports, devices, the virtual machine and files are in this
package.

Files:

- `board`: Which programs run on the boards of the applicator?
- `cab`: Which devices does one machine have, and what do they read and obey in a tick?
- `cab_config`: Which devices does a machine have, and where are they connected?
- `cab_line`: How is the line of one device in the cab managed?
- `datagrams`: How are datagrams sent and received over UDP?
- `day_clock`: Which day is it by the computer's clock?
- `device_status`: What is the state of one device in the cab?
- `devices`: How are the bytes of a device decoded?
- `files`: Which files does topdress read and write?
- `plain_text`: Which characters of foreign text may a terminal show?
- `plugin_host`: How does the code of a plug-in run in its own process?
- `plugin_process`: How is the code of a plug-in called safely?
- `plugins`: Which plug-ins do other packages add to topdress by entry points (CONTRIBUTING.md
- `ports`: How do bytes reach a device and come back without blocking the control loop?
- `virtual`: How does a simulated machine communicate like a real machine?
"""
