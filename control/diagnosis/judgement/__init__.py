"""Weighs candidate causes with one model, one score, and declared priors.

Everything that a log can show is a model M of a group of channels, Gaussian around its best fit:

    y = prediction(tolerances, sizes of M) + freedom of form of M + drift + noise

Sizes, tolerances and freedom of form are columns with normal priors. In the cosine domain the noise
of neighbouring coefficients is independent and of equal strength over a narrow band, so small
matrices contain all information (`evidence`), and the sizes are integrated in closed form
(`gaussian`). The score of a model is its log evidence plus the logarithm of its prior odds
(`prior`). The score of an effect is the score of a model with the effect minus that without: its
log posterior odds against no effect.

Noise never agrees exactly with its model. In frequency: the variance of each band is the fitted
spectrum's times a factor with an inverse-gamma prior, so that the coefficients of a band follow a
Student t (`noise_fit`). In time: the score of a column over blocks of the log is treated in the
same way (`control/diagnosis/runs/whitened.py`). A column's gain is the smaller of the two, because
the evidence must hold under both.

Begin and end times are averaged over all times of the log, not maximised, so the score includes the
price of the search. A posterior compares models and does not say that the best is adequate;
`checks` tests that with the noise that the machine file predicts.

References
----------
Kass and Raftery, Bayes factors, JASA 90, 1995. Madigan and Raftery, JASA 89, 1994 (models within a
window of the best). Roever, Meyer and Christensen, Classical and Quantum Gravity 28, 2011, 015010
(Student t in the frequency domain). Brynjarsdottir and O'Hagan, Inverse Problems 30, 2014 (freedom
of form). Gelman, Meng and Stern, Statistica Sinica 6, 1996 (checks).

Files:

- `checks`: Tests whether a model's residual is noise, for every channel and log
- `evidence`: Compresses data and columns of coupled channels to band products
- `gaussian`: Calculates posteriors, evidence and gains of columns under Gaussian noise
- `line_search`: Searches a maximum in one dimension in decreasing steps
- `noise`: Models the noise of a channel
- `noise_fit`: Compiled spectrum and fit of the noise
- `prior`: Declares the priors: every number on which a judgement depends, with its reason
- `rows`: Calculates the log evidence of a linear model of a few rows
"""
