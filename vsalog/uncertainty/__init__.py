"""What a fit's standard deviation counts, sample by sample.

`long_run` is the covariance that residuals show. Two terms that residuals cannot show have closed forms: the random walk that a
torque's noise becomes in an integrated equation (`integrated_noise`), and the bias by noise in regressors
(`errors_in_variables`). Everything else is tested on the whole estimator, see `vsalog.perturbations`.
"""
