"""What a rig's simulation gets wrong, why, and what mending it is worth."""
