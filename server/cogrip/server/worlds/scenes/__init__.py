"""Scenes of rigid bodies from MJCF and URDF: read and judged by MuJoCo's loader, stepped, measured and drawn."""
