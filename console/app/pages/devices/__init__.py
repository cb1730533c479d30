"""The Devices page shows every device, its last lines and its state.

Files:

- `device_table`: Shows one row per device
- `device_view`: Words a frame's devices for the Devices screen
- `keys`: Defines the keys of the Devices page; all act on the picked device
- `labelled_rows`: Draws an optional heading and rows of label and text
- `page`: Shows the Devices screen
"""
