"""From canopy to rate: crops, the nitrogen optimisation, day counts, sampling statistics,
fusion of the heads."""
