"""Belief over time: odometry, filter, late fixes, smoothing."""
