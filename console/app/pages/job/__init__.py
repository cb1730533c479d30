"""The Job page."""
