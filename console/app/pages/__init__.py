"""Each page has a folder with its screen, its keys and their functions, its words, its widgets and
its styles.

Files:

- `base_page`: Defines the parts that every screen has
- `calibrate`: The Calibrate page guides through five calibrations of the machine
- `devices`: The Devices page shows every device, its last lines and its state
- `diagnosis`: The Diagnosis page finds faults of the machine in its logs and adopts corrections
- `job`: The Job page shows the checks before work, the job's files, totals, strips and refills
- `log_page`: Shows the machine at work, or a log in its place; Run
- `map`: The Map page shows the field with applied rates, plan, overlaid files and the machine
- `page_registry`: Maps the name of a page to the page; a page is imported and built on first use
- `panel_page`: Defines the panels that Run and Replay share
- `replay`: The Replay page plays a log, as recorded or recomputed with another strategy
- `run`: The Run page shows the machine at work and sends orders to it
- `settings`: The Settings page shows and changes the user's settings
- `trends`: The Trends page plots channels of the run or a log over time
"""
