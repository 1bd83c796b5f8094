"""Prediction of where people will be."""
