"""The papers' numbers, and ours: one module per paper, a catalogue of their items, and what they come out as."""
