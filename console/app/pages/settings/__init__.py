"""The Settings page shows and changes the user's settings.

Files:

- `keys`: Defines the keys of the Settings page
- `page`: Shows the Settings screen
- `service`: Declares the store of the user's settings
"""
