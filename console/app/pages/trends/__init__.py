"""The Trends page plots channels of the run or a log over time.

Files:

- `channel_plots`: Plots up to three channels in braille, stacked on one time axis
- `keys`: Defines the keys of the Trends page and their functions
- `page`: Shows the Trends screen: up to three channels of the run or log over any span
"""
