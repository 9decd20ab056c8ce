"""The papers' numbers, and ours: one module per paper, a catalogue of their items, and their results."""
