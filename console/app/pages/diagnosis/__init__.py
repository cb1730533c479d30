"""The Diagnosis page finds faults of the machine in its logs and adopts corrections.

Files:

- `adoption`: Selects the causes that a machine file adopts with an Enter
- `causes`: Shows every cause: name, size, probability, alternatives, cost
- `channel_table`: Shows for each channel the error of the machine file
- `diagnosis_words`: Words a diagnosis on its page
- `keys`: Defines the keys of the Diagnosis page and their functions
- `page`: Shows the Diagnosis screen
- `panel_views`: Converts a diagnosis to the views of the page's panels
- `residual_plot`: Plots measured minus predicted values over one variable
- `run_plan`: Shows the plan of the separating run
- `service`: Declares the data, results and functions that the Diagnosis page receives
- `verdict`: Shows the verdict in a word and a sentence with the next step
"""
