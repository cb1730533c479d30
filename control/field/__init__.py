"""The field: its edge, the passes over it, what is done of it, and the totals. Metres on the field's tangent plane."""
