"""Compares the model with a log that is still being written.

Files:

- `growing_log_check`: Checks a growing log every half minute
- `sequential_test`: Sequential test for effects that started within the last minutes
"""
