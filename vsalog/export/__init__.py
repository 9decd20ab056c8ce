"""Rigs as models of other simulators: MuJoCo's XML and URDF."""
