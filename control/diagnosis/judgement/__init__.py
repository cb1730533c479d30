"""How candidate causes are weighed: one model, one score, stated priors.

Everything that a log can show is a model M of a group of channels, Gaussian about its best fit:

    y = prediction(tolerances, sizes of M) + freedom of form of M + drift + noise

Sizes, tolerances and freedom of form are columns with normal priors. In the cosine domain the
noise of neighbouring coefficients is independent and of one strength over a narrow band, so
that all of it is had from small matrices (`evidence`), and the sizes are integrated in closed
form (`gaussian`). The score of a model is its log evidence plus the logarithm of its prior odds
(`prior`). That of an effect is the score of a model with it less that without it: its log
posterior odds against nothing in its place.

Noise is never quite what a model says. In frequency: the variance of each band is the fitted
spectrum's times a factor with an inverse-gamma prior, so that the coefficients of a band follow
a Student t (`noise_fit`). In time: the score of a column over blocks of the log is treated
alike (`control/diagnosis/runs/whitened.py`). What a column gains is the smaller of the two: the
evidence must hold under both.

When something begins or ends is averaged over all times of the log, not maximised: the price of
looking everywhere is in the score. A posterior compares models and does not say that the best
of them is any good: `checks` does, by the noise that the machine file leads one to expect.

References
----------
Kass and Raftery, Bayes factors, JASA 90, 1995. Madigan and Raftery, JASA 89, 1994 (models
within a window of the best). Roever, Meyer and Christensen, Classical and Quantum Gravity 28,
2011, 015010 (Student t in the frequency domain). Brynjarsdottir and O'Hagan, Inverse Problems
30, 2014 (freedom of form). Gelman, Meng and Stern, Statistica Sinica 6, 1996 (checks).

Files:

- `checks`: Whether what a model leaves is noise
- `evidence`: Data and columns of coupled channels compressed to band products
- `gaussian`: Columns under a noise: whatever is asked of their sizes
- `line_search`: The one search in one dimension
- `noise`: The noise of a channel: a fast and a slow first-order component over a white floor
- `noise_fit`: The noise's spectrum and its fit, compiled
- `prior`: What is believed before the data are seen
- `rows`: Log evidence of a linear model of a few rows, with the strength of their noise integrated
"""
