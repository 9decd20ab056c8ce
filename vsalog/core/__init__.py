"""Shared by every layer: recordings, signals, traces, models, findings, units and errors."""
