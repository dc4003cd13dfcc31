"""Minimisation of least-squares objectives; knows nothing of actuators and recordings."""
