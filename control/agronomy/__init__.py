"""Determines the product that a canopy needs: crops, nitrogen rules, day counts, sampling
statistics, fusion of the canopy heads.

Files:

- `crop`: How does a crop turn NDVI into a rate of product, and within which limits?
- `days`: How many days since sowing were warm enough to grow?
- `fusion`: Which of the canopy heads can be trusted, and which NDVI do they measure together?
- `growth`: Is the crop at the growth stage for which its rule was made?
- `noa`: How much product does an NDVI ask for?
- `product`: Which product is spread?
- `reference_strips`: Which NDVI do the N-rich strip and the farmer check have
- `response`: How strongly does a field respond to nitrogen
- `sampling`: How uniform is a canopy, and how often must it be sensed?
- `yield_potential`: How much does a crop yield without topdressing?
"""
