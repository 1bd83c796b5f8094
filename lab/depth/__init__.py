"""The depth sensor and its errors."""
