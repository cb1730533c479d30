"""From canopy to rate: crops, the nitrogen optimisation, day counts, sampling statistics,
fusion of the heads.

Files:

- `crop`: A crop file: everything that turns NDVI into a rate of product
- `days`: D of paper A, eq 4: how many days since sowing were warm enough to grow
- `fusion`: Six canopy heads to one NDVI: the median of the heads that can be trusted
- `growth`: Is the crop at the stage for which its rule was made?
- `noa`: The nitrogen optimisation of paper A, eq 2 to 5: NDVI to kg of product per ha
- `product`: A product file: what is spread
- `response`: The response index of a field as its authors at Oklahoma State define it
- `sampling`: How even a canopy is, and how often it must be looked at (paper A, section 1.2, eq 1
- `strips`: The two strips of a field, N-rich and farmer check
- `yield_potential`: The yield curve of a crop, tied to the day rule it was fitted with (paper A
"""
