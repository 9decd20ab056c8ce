"""Causal (kinematic Kalman) and non-causal (Savitzky–Golay) filters, as folds over blocks of samples."""
