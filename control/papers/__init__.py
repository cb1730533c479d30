"""What the three papers print, and the same from this program's models; see `topdress
reproduce`.

Files:

- `claims_decision`: Every claim of the decision paper, and what comes out
- `claims_lag`: Every claim of the lag paper, and what comes out
- `correction`: The lag paper's correction experiment (section 2.3
- `decision`: The decision paper: sampling (table 1), rate over NDVI (figure 4), amounts (table 2)
- `elements`: Every element that the papers describe, and where it is in this program
- `experiments`: One machine, every table of the lag paper
- `lag`: The lag paper: lag distances, response, drop times, the whole lag, the line, the correction
- `map_geometry`: The lag paper's geometry on the prescription map
- `page`: What a page of reproductions is made of
- `points`: The point paper: delays, shaft speeds by microstep, and where doses land
- `published`: Figures that the papers print, as they print them
- `trial`: A field trial of one's own, looked at as the decision paper looks at its own
"""
