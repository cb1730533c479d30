"""What do the three papers print, and what do this program's models give? See `topdress
reproduce`.

Files:

- `claims_lag`: Which claims does the lag paper make, and does each hold here?
- `correction`: What does the lag paper's correction experiment (section 2.3
- `decision`: Does the decision paper come out here?
- `decision_paper_claims`: Which claims does the decision paper make, and does each hold here?
- `elements`: Which elements do the papers describe, where are they in this program
- `experiments`: Does one machine reproduce every table of the lag paper?
- `lag`: Does the lag paper come out here?
- `map_geometry`: Is the lag paper's geometry on the prescription map right?
- `page`: What does a page of reproductions consist of?
- `points`: Does the point paper come out here?
- `published`: Which figures do the papers print?
- `trial`: How does a field trial of one's own compare with the decision paper's?
"""
