"""A run log to a diagnosis: show, name, say what else it could be, measure the gain, plan the
next run.

Files:

- `adoption`: What of a diagnosis a machine file may take up
- `changepoint`: Effects that begin, grow, or come and go within a log
- `channels`: Each channel's prediction through the machine model
- `closed_loop`: What knowing a machine's effects gains in the field
- `columns`: What one unit of anything does to a group's channels
- `compared`: Two machine files held against the same log
- `cost`: What a named effect does in the field when nobody compensates it
- `diagnose`: Diagnosis of a run log, from columns to verdict
- `dictionary`: What is tried beyond the catalogue
- `drive_curve`: Effects that make one curve, or one answer to a step, together
- `drives`: Shaft and gate of a log: each drive's command and read-back
- `effort`: How hard the drives worked in a log
- `effort_reference`: What a sound drive takes to move
- `findings`: Sentences about the recorded data itself
- `gain`: What putting the model right gains on blocks of the log that no size was fitted to
- `grid`: Readings on an even time grid
- `held_out`: Blocks of a log that no size is fitted to, and the errors on them
- `hopper`: Flow and scale of a log, in bins of a second
- `hypothesis`: A hypothesis: effects with sizes, and the machine's stages as they are under it
- `inputs`: What several stages are given, at every row of a log
- `intermittent`: Effects that come in spells at times of their own
- `log`: What is odd about the recorded data itself, put right where that is safe and always said
- `model`: Channels that share effects, through the machine model
- `nominal_values`: Nominal values moved, within their tolerances, to where they fit best
- `onset`: When an effect began: stops read off the drives
- `quantised`: A shaft speed that is read in steps
- `rates`: Applied against target, of data that hold no more than rates
- `report`: What was judged, in the words of the published result
- `residual_analysis`: What the channels of a group have left that is not noise, once its names
- `robust`: Heavy-tailed noise made to count as a robust fit would count it
- `row_order`: Which row of a foreign log holds a command, and which what answered it
- `search`: The search over hypotheses of one group
- `selection`: Which set of effects one group of channels shows
- `several`: Several logs of one machine
- `smooth`: Smooth, nameless dependence of a stage on one recorded variable
- `speed_and_heads`: Ground speed and canopy heads of a log
- `stages`: A run log as the machine model's stages see it
- `terms`: Terms that a log shows beyond the catalogue
- `whitened`: What a hypothesis leaves of a group's channels, whitened, against which columns
"""
