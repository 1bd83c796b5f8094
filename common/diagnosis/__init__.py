"""Diagnosis of a running system from its messages."""
