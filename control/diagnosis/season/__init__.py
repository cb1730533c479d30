"""Many logs of many machines together: what each effect did over a season, and what is shared."""
