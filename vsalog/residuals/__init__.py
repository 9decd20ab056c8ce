"""Residuals of a log under a rig: equations on filtered channels, each with its noise, and simulations over short windows."""
