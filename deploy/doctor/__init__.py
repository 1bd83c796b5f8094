"""Diagnosis of a system without output: evidence gathered, diagnostics concluded."""
