"""What the pages have done with files and long work: the services of `console.app.services` on
real files.

Files:

- `calibrate`: What the Calibrate screen has computed and saved
- `diagnosis`: Files and long work of the Diagnosis page
- `diagnosis_job`: The Diagnosis page's heavy work as a process of its own
- `diagnosis_view`: A diagnosis as the Diagnosis page has it
- `driven_field`: A boundary that was driven as the field of a job
- `field`: The picture of a frame's field for the maps
- `fleet`: Thousands of logs on a Dask cluster, each diagnosed once
- `fleet_job`: What a worker of the fleet does with one log
- `fleet_metadata`: The list of logs that `--about` names
- `fleet_season`: The records of a fleet put together
- `fleet_tables`: A season as Parquet files for other programs
- `foreign_files`: Files of other machines and programs
- `job`: What the Job screen has done
- `launcher`: How control workers are started from the console, and with which files
- `layers`: Files of other days for the Map page
- `line_files`: The A-B line and a boundary that is being driven
- `live_check`: The live check as a process of its own
- `live_checker`: The console's end of the live check
- `logs`: The logs that the Replay page can open
- `map_refused`: Why a file is not taken as a prescription, in the language of the screen
- `recent`: What was worked lately, by the sidecars of its logs
- `removable_media`: Where prescriptions lie: on sticks, among downloads, in the user's own folder
- `replay_frames`: A run log as frames for the Replay screen
- `rerun`: The control loop once more over the measurements of a log
- `running_limits`: What a running machine goes by, as its log's sidecar has it
- `separating_run`: The run that tells rivals apart
- `settings`: The user's settings for the console
- `sound`: Sounds of alarms: a command of the user's own, started and left to itself
"""
