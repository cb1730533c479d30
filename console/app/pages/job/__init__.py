"""The Job page shows the checks before work, the job's files, totals, strips and refills.

Files:

- `checklist`: Words the Job screen: checks before work, totals, refills
- `checklist_panel`: Draws the list of checks before work
- `keys`: Defines the keys of the Job page and their functions
- `map_dialog`: Shows a prescription map before the job uses it
- `map_words`: Words the check of a job's map before work
- `page`: Shows the Job screen: checks before work, the job's files, N-rich strip, refills, totals
- `refill`: Recognises a refill by the scale
- `service`: Declares the files and functions that the command line supplies to the Job screen
- `strip_measurement`: Measures an N-rich strip or a farmer check between two key presses
"""
