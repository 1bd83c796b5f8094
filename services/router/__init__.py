"""Router of one host: a Zenoh session in router mode."""
