"""Watches the pipeline and writes a contact sheet, a video and a summary of what it did."""
