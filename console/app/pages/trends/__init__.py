"""The Trends page.

Files:

- `keys`: Keys of the Trends page and what they do
- `page`: The Trends screen: up to three channels of the run or log, over any span, frozen
- `plots`: Up to three channels, one above the other, on one time axis, in braille
"""
