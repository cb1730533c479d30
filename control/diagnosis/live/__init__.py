"""The model held against a log that is still being written."""
