"""How are the services of the pages implemented on real files? This package implements
`console.app.services`: files and long work.

Files:

- `calibrate`: How does the Calibrate screen fit bench tables and save the result as a new machine
- `diagnosis`: How does the Diagnosis page find its logs and run a diagnosis?
- `diagnosis_job`: How does the slow work of the Diagnosis page run as a process of its own
- `diagnosis_view`: How is a diagnosis prepared for the Diagnosis page?
- `driven_field`: How does a driven boundary become the field of a job?
- `field`: How is the field of a frame drawn on the maps?
- `fleet`: How are thousands of logs diagnosed on a Dask cluster, each once?
- `fleet_job`: How does a worker of the fleet diagnose one log?
- `fleet_metadata`: Which row of the list that `--about` names belongs to which log
- `fleet_season`: How are the records of a fleet combined?
- `fleet_tables`: How is a season written as Parquet files for other programs?
- `foreign_files`: Which files come from other machines and programs
- `job`: How does the Job screen work with files?
- `launcher`: How does the console start control workers, and with which files?
- `line_files`: How are the A-B line and a boundary during its drive stored?
- `live_check`: How does the live check run as a process of its own
- `live_checker`: How does the console run the live check?
- `map_refusal`: Why is a file refused as a prescription?
- `overlay_files`: How does the Map page show files of other days?
- `recent_jobs`: Which jobs were worked lately?
- `removable_media`: Where are prescriptions?
- `replay_frames`: How does a run log become frames for the Replay screen?
- `replay_rerun`: How is the control loop run again on the measurements of a log
- `run_logs`: Which logs can the Replay page open?
- `running_limits`: Which limits does a running machine use, and what happened earlier in its run?
- `separating_run`: How is the run that separates rival causes driven on the simulated machine and
- `settings`: How are the user's settings for the console stored?
- `sound_player`: How do alarms sound? A command of the user is started and not waited for
"""
