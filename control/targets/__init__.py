"""Finds the target of each position: profiles along the track, and the queue of rate changes with
look-ahead.

Files:

- `boundary_profile`: Where along the working line is the field?
- `canopy_target`: Which rate does the canopy ask for along the track?
- `done_ground_ahead`: Which ground ahead along the working line has its material from an earlier
- `external_target`: Which target does another display send, and which holds while it is silent?
- `index_map`: Which canopy index does a drone's or satellite's map show at a place?
- `lag_correction`: When is a change of the target made so that it lands at its place?
- `map_check`: Which part of a prescription will not be applied as it stands?
- `map_profile`: Which targets of the prescription lie ahead of the outlets?
- `plant_doser`: Which dose is due in this tick?
- `plant_places`: Where along the track do the plants stand?
- `point_mode`: When is the dose of a plant commanded?
- `prescription`: Which rates does a prescription give?
- `rate_map`: Which rate does a map have at a place, and where along a straight line may it change?
- `section_ground`: Does the ground under each section get material at a place of the way
- `target_profile`: Which target holds at a place of the track, and where does it change next?
"""
