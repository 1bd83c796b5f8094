"""Outputs of a scenario: recordings, bags, files of truth, previews."""
