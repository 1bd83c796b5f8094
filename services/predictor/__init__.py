"""Prediction of future positions of people."""
