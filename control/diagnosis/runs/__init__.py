"""A run log to a diagnosis: show, name, say what else it could be, measure the gain, plan the
next run."""
