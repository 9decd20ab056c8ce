"""Identification: the rig's own numbers fitted to a log, before anything is asked about causes."""
