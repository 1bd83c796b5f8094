"""Deployment: compose file, launcher, doctor, exporters, command line."""
