"""The Devices page.

Files:

- `device_table`: One row a device: symbol and word, rate, age, accepted, rejected, protocol, port
- `device_view`: Devices as the Devices screen shows them
- `keys`: Keys of the Devices page and what they do, all to the device that is picked
- `page`: The Devices screen: every line of the machine, what it says
- `rows`: A heading, where it has one, and rows of label and text; a long text is broken, not cut
"""
