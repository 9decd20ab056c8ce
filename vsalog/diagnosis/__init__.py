"""What a rig's simulation gets wrong, why, and what a better model is worth."""
