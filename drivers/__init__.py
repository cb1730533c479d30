"""What is connected: ports, devices, the virtual machine, files."""
