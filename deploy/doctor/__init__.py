"""Diagnosis of a system without output: evidence and diagnostics."""
