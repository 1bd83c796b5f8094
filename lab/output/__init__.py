"""Outputs of a scenario: recordings, bags, truth files, previews."""
