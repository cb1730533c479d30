"""The Map page shows the field with applied rates, plan, overlaid files and the machine.

Files:

- `keys`: Defines the keys of the Map page and their functions
- `map_pane`: Shows the large map: dragging moves it, the wheel zooms at the pointer
- `overlay_legend`: Loads the file that is overlaid on the map, and shows its legend in one row
- `page`: Shows the Map screen: the field by applied rate, target, error or NDVI
- `place_reading`: Words the map's values at one position and the state of the whole job
- `service`: Declares the functions that the Map page receives
"""
