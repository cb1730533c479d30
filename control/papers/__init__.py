"""Compares the numbers printed in the three papers with the results of this program's models
(`topdress reproduce`).

Files:

- `correction_experiment`: What results does the lag paper's correction experiment (section 2.3
- `decision_paper`: Which results of the decision paper do the models reproduce?
- `decision_paper_claims`: Which claims does the decision paper make, and does each hold here?
- `field_trial`: How does a user's field trial compare with the decision paper's?
- `lag_experiments`: Does one machine reproduce every table of the lag paper
- `lag_paper`: Which results of the lag paper do the models reproduce?
- `lag_paper_claims`: Which claims does the lag paper make, and does each hold here?
- `map_geometry`: Is the lag paper's geometry on the prescription map right?
- `page`: Defines the content of a page of reproductions
- `paper_elements`: Lists the elements that the papers describe, their place in this program
- `point_paper`: Which results of the point paper do the models reproduce?
- `published`: Contains the numbers that the papers print, unchanged, for comparison only
"""
