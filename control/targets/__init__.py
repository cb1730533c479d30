"""Which target holds where: profiles along the track, and the queue of rate changes that looks
ahead.

Files:

- `boundary_profile`: The field's edge seen along the working line
- `canopy`: Canopy mode: fused NDVI under the heads, collected for a decision period
- `index_map`: The canopy's index by places, as a drone or a satellite saw it
- `lag_correction`: The look-ahead
- `map_check`: What of a prescription will not be applied as it stands
- `map_profile`: Map mode: the prescription seen ahead of the outlets, as a profile along the track
- `outside_target`: The target that another display tells, and what holds while it is silent
- `overlap`: Ground that has its material from an earlier pass, seen ahead along the working line
- `plants`: Plants to be given a dose each
- `point`: Point mode: one dose a plant
- `point_source`: Point mode in the loop: plants ahead become dose orders on ticks
- `prescription`: A prescription: rates by cells or zones in degrees, as files hold them
- `profile`: A target along the track
- `rate_map`: What a map says at a place, and where along a straight line it may say something else
- `section_ground`: What the ground under each section wants, at one place of the way
"""
