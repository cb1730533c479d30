"""The Settings page.

Files:

- `keys`: Keys of the Settings page and what they do
- `page`: The Settings screen: units, language, look, sound, limits, rates, and every key
- `service`: What the Settings page is given
"""
