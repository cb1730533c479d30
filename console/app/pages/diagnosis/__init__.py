"""The Diagnosis page.

Files:

- `adoption`: What of a diagnosis a machine file takes up with an Enter
- `causes`: Every cause: what, how big, how sure, what else it could be, what it costs
- `channel_table`: Channel by channel: how far the machine file is off
- `keys`: Keys of the Diagnosis page and what they do
- `page`: The Diagnosis screen: choose data, watch, read the verdict, adopt it
- `residual_plot`: Measured less predicted along one variable
- `run_plan`: The run that would tell rivals apart
- `service`: What the Diagnosis page is given
- `shown`: The Diagnosis page's views
- `verdict`: The verdict: one word, one line, what to do; next to it that of the separating run
- `words`: A diagnosis on its page: which data, what to do by its keys, numbers in the units in use
"""
