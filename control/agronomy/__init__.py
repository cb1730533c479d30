"""Determines the product that a canopy needs: crops, nitrogen rules, day counts, sampling
statistics, fusion of the canopy heads.

Files:

- `crop`: How does a crop turn NDVI into a rate of product, and within which limits?
- `growing_days`: How many days since sowing were warm enough to grow?
- `growth_stage`: Is the crop at the growth stage for which its rule was made?
- `head_fusion`: Which of the canopy heads can be trusted, and which NDVI do they measure together?
- `nitrogen_rate`: How much product does an NDVI ask for?
- `nitrogen_response`: How strongly does a field respond to nitrogen
- `product`: Which product is spread?
- `reference_strips`: Which NDVI do the N-rich strip and the farmer check have
- `sampling_frequency`: How uniform is a canopy, and how often must it be sensed?
- `yield_potential`: How much does a crop yield without topdressing?
"""
