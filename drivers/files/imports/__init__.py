"""Logs of any machine as topdress run logs: what a file holds, what its columns mean, and the
conversion."""
