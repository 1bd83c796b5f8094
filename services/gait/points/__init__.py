"""Points of a body tracked on its surface."""
