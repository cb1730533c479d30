"""The model held against a log that is still being written.

Files:

- `rolling`: The sequential test
- `watch`: A log that is still being written, looked at every half minute
"""
