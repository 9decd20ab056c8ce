"""What every layer knows: recordings, signals, traces, models, findings, units and errors."""
