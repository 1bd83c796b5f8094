"""Cameras with an SDK, each a plug-in of the entry point people4d.cameras."""
