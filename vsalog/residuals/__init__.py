"""What a log leaves over of a rig: equations on filtered channels, each with its noise, and simulations over short windows."""
