"""Fitting parameters through the simulation by least squares."""
