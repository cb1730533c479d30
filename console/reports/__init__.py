"""What is written for people to read: diagnosis summaries and reports, job reports, pictures.

Files:

- `binned`: A residual against a variable
- `chart`: Charts as SVG: lines, points with intervals, bands, bars and coloured ground
- `compare_page`: Two machine files held against the same logs
- `diagnosis_html`: A diagnosis as one HTML file that needs nothing else
- `diagnosis_text`: A diagnosis in words: what, how sure, what it costs, what to do
- `diagnosis_wording`: What a diagnosis says, once for terminal, report, notebook and Diagnosis page
- `effects_page`: The catalogue of effects as a page of documentation
- `fleet_page`: One page for the owner of machines
- `html`: Words into HTML: everything that comes from files or users is escaped here
- `job_about`: What a handover sheet tells next to the figures
- `job_page`: The report of a job: what was applied where, how much, how evenly
- `live_words`: A departure from the model in one line, in the language in use
- `notebook`: A diagnosis in a notebook
- `numbers`: Numbers as people write them
- `panels`: Parts of a picture that runs and tables share
- `paper_page`: The page of `topdress reproduce`
- `pictures`: Which pictures a diagnosis has
- `run_pictures`: Pictures of a run: what each cause does and what is left, stretches in full
- `run_views`: A run log's channels as a report shows them
- `table_pictures`: Pictures of a bench table
- `table_views`: A bench table's measured columns as a report shows them
- `term_words`: A term in one sentence, the same in terminal, report and page
- `variables`: Recorded variables and settings in plain words, with their units
"""
