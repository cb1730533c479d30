"""The control worker: a program of its own that owns devices, loop and log (`python -P -m
console.worker`)."""
