"""The Run page shows the machine at work and sends orders to it.

Files:

- `keys`: Defines the keys of the Run page, which send orders to the machine
- `page`: Shows the Run screen: the machine at work
- `section_bar`: Shows which sections with valves are open, and why the others are closed
"""
