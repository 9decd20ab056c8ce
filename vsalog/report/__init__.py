"""Results as text: the terminal, and JSON for programs."""
