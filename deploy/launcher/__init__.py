"""Runs the services of a compose file as local processes on supervisord."""
