"""A folder for each page: its screen, its keys with what they do, its words, its own widgets
and styles.

Files:

- `all`: All pages of the console, by the word that their actions carry
- `calibrate`: The Calibrate page
- `devices`: The Devices page
- `diagnosis`: The Diagnosis page
- `job`: The Job page
- `log_page`: A page that shows the machine at work, or a log in its place
- `map`: The Map page
- `page`: What every screen has: state and alarms above, pages and keys below
- `panel_page`: What Run and Replay share
- `replay`: The Replay page
- `run`: The Run page
- `settings`: The Settings page
- `trends`: The Trends page
"""
