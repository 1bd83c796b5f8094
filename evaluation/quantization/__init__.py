"""Quantisation of networks to 8 bits, accepted by what it costs in accuracy."""
