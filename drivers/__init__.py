"""What is connected: ports, devices, the virtual machine, files.

Files:

- `board`: Programs of the boards on the applicator
- `cab`: The cab: all ports and drivers of one machine
- `cab_config`: The cab file: which devices a machine has and where they are plugged in
- `cab_line`: One device's line in the cab
- `datagrams`: UDP: datagrams in and out, whole ones only
- `day_clock`: What day it is, by the computer's clock, whatever that says
- `device_status`: What is known of one device in the cab
- `devices`: One file a protocol: bytes in, readings out
- `files`: Files: configuration, run logs, replay, tables of other programs
- `plain_text`: Text from files, devices and networks before a terminal sees it
- `plugin_host`: The program that runs the code of a plug-in
- `plugin_process`: Asks the code of a plug-in, which runs in a process of its own
- `plugins`: What other packages add to topdress by entry points (CONTRIBUTING.md, "Plug-ins")
- `ports`: Ports: bytes in and out of one device, never blocking the control loop
- `virtual`: The virtual machine
"""
