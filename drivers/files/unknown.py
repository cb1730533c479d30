"""Words by which tables say that a value is not known."""

NOTHING = frozenset({"", "-", "--", "na", "n/a", "nan", "null", "none", "nil", "#n/a", "inf", "-inf"})   # in lower case
