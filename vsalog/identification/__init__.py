"""Identification: the rig's own numbers fitted to a log, before causes are searched."""
