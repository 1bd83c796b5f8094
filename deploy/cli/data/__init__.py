"""Commands on recordings, tables and model files."""
