"""Files: configuration, run logs, replay, tables of other programs."""
