"""Wanted flow to a pair of shaft speed and opening: the inverse of the machine model,
strategies, trims."""
