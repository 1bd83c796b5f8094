"""Predictions of the predictor beside what people did."""
