"""Quantisation of networks to int8 with accuracy control."""
