"""Screens that cover a page: alarms, help, jump letters, lost worker.

Files:

- `alarm_list`: Shows all alarms of the run
- `help_screen`: Shows the keys of a screen, a glossary and the meaning of signs (F1)
- `jump_letters`: Shows letters over everything clickable; typing a letter clicks
- `worker_lost_screen`: Shows at once and in large letters that the control worker is lost
"""
