"""The field: its edge, what is done of it, and the totals. Metres on the field's tangent plane."""
