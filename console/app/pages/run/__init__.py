"""The Run page.

Files:

- `keys`: Keys of the Run page and what they do
- `page`: The Run screen: the machine at work
- `section_bar`: One line on the Run page of a machine whose sections have valves
"""
