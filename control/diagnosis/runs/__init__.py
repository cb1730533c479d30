"""Diagnosis of a run log: shows errors, names their causes, lists alternatives, measures the gain
and plans the next run.

Files:

- `adoption`: Selects the causes and terms of a diagnosis that a machine file may adopt
- `changepoint`: Score tests for effects that begin, grow, or come and go within a log
- `channels`: Predicts each channel through the machine model and calculates what the prediction
- `closed_loop`: Measures the gain of known effects in the field by two simulated runs of the
- `columns`: Builds the regression columns of a group
- `compared`: Compares two machine files on the same log
- `cost`: Estimates the cost of a named effect in the field when it is not compensated
- `diagnose`: Diagnoses a run log, from columns to verdict
- `dictionary`: Searches terms beyond the catalogue
- `drive_curve`: Starts hypotheses of several effects that together form one drive curve or one
- `drives`: Reads shaft and gate from a log
- `effort`: Reads how hard the drives worked in a log, in time bins
- `effort_reference`: Fits the reference effort of healthy drives to a run
- `findings`: Writes findings about the recorded data
- `gain`: Measures the gain of the corrected model on blocks of the log to which no size was fitted
- `grid`: Resamples readings onto an even time grid
- `held_out`: Splits a log into fitted and held-out blocks
- `hopper`: Reads flow and scale of a log in bins of a second
- `hypothesis`: Defines a hypothesis: effects with sizes
- `inputs`: Prepares inputs that several stages share, at every row of a log
- `intermittent`: Finds intermittent effects at irregular times directly in the data
- `log`: Examines the recorded data for anomalies, corrects them where that is safe
- `model`: Models a group of channels that share effects
- `nominal_values`: Fits nominal values within their tolerances
- `onset`: Finds when an effect began
- `quantised`: Handles a shaft speed that is read in steps
- `rates`: Compares applied with target rate in data that hold no more than rates
- `report`: Writes the published result of a diagnosis
- `residual_analysis`: Examines the residual of a group after its named effects
- `robust`: Transforms heavy-tailed noise so that least squares gives the result of a robust fit
- `row_order`: Detects whether a foreign log stores commands and answers in other rows than ours
- `search`: Searches over hypotheses of one group
- `selection`: Selects the set of effects that one group of channels shows
- `several`: Diagnoses several logs of one machine
- `smooth`: Models a smooth, nameless dependence of a stage on one recorded variable
- `speed_and_heads`: Compares redundant sensors of a log where both have new readings
- `stages`: Prepares a run log for the machine model's stages
- `terms`: Searches terms that a log shows beyond the catalogue
- `unit_change`: Did a column change its unit within a log?
- `whitened`: Calculates the whitened residual of a hypothesis, the gain of columns
"""
