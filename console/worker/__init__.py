"""The control worker is a program of its own that owns devices, loop and log (`python -P -m
topdress.console.worker`).

Files:

- `assemble`: Builds the parts of one run from its options
- `client`: Holds one connection of the link on the worker's side
- `device_service`: Executes orders for single devices
- `lag_bench`: Runs the lag test in the worker
- `limits`: Declares every limit of the control worker
- `link_server`: Serves the worker's end of the link
- `loop_host`: Hosts the control loop: it runs one tick after the other at absolute deadlines
- `options`: Parses the worker's options
- `program`: Runs the worker as a program
- `real_time`: Contains everything that differs between Linux, macOS and Windows
- `requests`: What a client may send: one JSON object a line
- `resume`: Reads and writes the snapshot next to the log, NAME.resume.json
- `resume_alarms`: Records every alarm of a run
- `resume_assemble`: Rebuilds an interrupted job
- `resume_field`: Selects unfinished jobs by position
- `resume_ground`: Records finished ground while it grows, and converts it to and from a file
- `resume_keeper`: Maintains the snapshot of a running job
- `resume_tail`: Adds the last seconds before a power cut
- `run_file`: Writes the run file, which tells where a worker listens and contains its token
- `run_interfaces`: Declares the parts that a host drives
- `side_files`: Appends to files next to the log in a thread
- `snapshots`: Lists the snapshots of jobs, NAME.resume.json
- `wire_format`: Converts frames, answers and the greeting to bytes, one JSON object per line
"""
