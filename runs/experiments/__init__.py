"""Experiments: the paper's measurements, repeated for each method on the same images."""
