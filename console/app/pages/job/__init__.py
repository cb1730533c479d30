"""The Job page.

Files:

- `check_list`: The list before work: what is looked at, a word for how it stands, and why
- `checklist`: The Job screen's words: the check list before work, the totals, what was filled in
- `keys`: Keys of the Job page and what they do
- `map_dialog`: A prescription before it is taken
- `map_words`: What is to be said of a job's map before it is worked
- `nrich`: A strip between two key presses, N-rich or farmer check
- `page`: The Job screen: a list before work, the files of the job, the N-rich strip, refills
- `refill`: A refill recognised by the scale
- `service`: What the Job screen is given by the command line
"""
