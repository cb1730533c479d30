"""Compares the model with a log that is still being written.

Files:

- `rolling`: Sequential test for effects that started within the last minutes
- `watch`: Checks a growing log every half minute
"""
