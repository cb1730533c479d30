"""The Map page.

Files:

- `keys`: Keys of the Map page and what they do
- `laid_legend`: One row: which file is laid on the map, and what its colours mean
- `map_pane`: The large map: drag moves it, the wheel changes its scale at the pointer
- `page`: The Map screen: the field by what was applied, wanted, missed or sensed, the plan under it
- `reading`: What a map says of one place and of the whole job, in words
- `service`: What the Map page is given
"""
