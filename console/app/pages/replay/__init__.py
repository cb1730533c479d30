"""The Replay page.

Files:

- `keys`: Keys of the Replay page and what they do
- `page`: The Replay screen: the same panels, fed from a log; a machine at work keeps its alarms
- `service`: What the Replay page is given
"""
