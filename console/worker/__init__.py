"""The control worker: a program of its own that owns devices, loop and log (`python -P -m
console.worker`).

Files:

- `assemble`: From options to the parts of one run
- `client`: One connection of the link as the worker sees it
- `device_service`: What is ordered of single devices
- `host`: The control loop's host: one tick after the other at absolute deadlines
- `lag_bench`: The lag test as the worker runs it
- `limits`: Every limit of the control worker, in one place
- `link_server`: The worker's end of the link
- `options`: What the worker is started with
- `parts`: The parts that a host drives
- `program`: The worker as a program: options, priority, assembly, link, loop
- `requests`: What a client may send: one JSON object a line
- `resume`: What is kept next to the log, so that a job goes on after a power cut
- `resume_alarms`: Every alarm of a run: when it first and last stood, how often it came
- `resume_assemble`: A job that was left, put together again
- `resume_field`: Jobs that are not done with, by place
- `resume_ground`: Ground that is done: as it grows, and as it is kept in a file
- `resume_keeper`: Keeps the snapshot of a running job
- `resume_tail`: The last seconds before a power cut
- `run_file`: The run file says where a worker listens and what opens it, for its own user only
- `side_files`: Files written next to the log
- `snapshots`: The files that jobs are gone on with, NAME.resume.json
- `system`: Everything that differs between Linux, macOS and Windows
- `wire`: Frames, answers and the greeting as bytes, one JSON object a line
"""
