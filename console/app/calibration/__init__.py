"""The calibrations that are driven from the console: what each has gathered, what comes next, what it shows."""
