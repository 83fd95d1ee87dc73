"""Photon maps: emission, tracing, the map with its kd-tree, density estimation, final gathering (Jensen 1996; Gautron 2006 §6)."""
