"""The meeting point of one host: a Zenoh session in router mode."""
