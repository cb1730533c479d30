"""Which texts and pictures do people read? They are diagnosis summaries and reports, job reports
and charts.

Files:

- `binned_means`: How does a residual depend on a variable?
- `chart`: How are charts drawn as SVG?
- `compare_page`: How are two machine files compared on the same logs?
- `diagnosis_html`: How is a diagnosis shown as one self-contained HTML file?
- `diagnosis_text`: How is a diagnosis summarised in words?
- `diagnosis_wording`: How is a diagnosis worded?
- `effects_page`: How is the catalogue of effects written as a page of documentation?
- `fleet_page`: How does an owner of machines see a season?
- `html`: How are words written into HTML?
- `job_metadata`: Which facts besides the figures does the report of a job contain?
- `job_page`: How is a job reported? The page shows the applied rates by position, the total
- `live_words`: How does one line show a departure from the model, in the language in use?
- `notebook`: How is a diagnosis shown in a notebook?
- `number_text`: How are numbers written for people?
- `panels`: Which parts of pictures do runs and tables share?
- `paper_page`: How does the page of `topdress reproduce` compare the papers' published numbers
- `pictures`: Which pictures does a diagnosis have?
- `run_pictures`: Which pictures show a run?
- `run_views`: How does a report show the channels of a run log?
- `table_pictures`: Which pictures show a bench table?
- `table_views`: How does a report show a bench table?
- `term_words`: How is a term described in one sentence, for terminal, report and page?
- `variable_names`: Which plain words and units do recorded variables and settings have?
"""
