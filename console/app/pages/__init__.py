"""A folder for each page: its screen, its keys with what they do, its words, its own widgets
and styles."""
