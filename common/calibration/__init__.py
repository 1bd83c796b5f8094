"""Extrinsics and clocks of several cameras from people who walk about, see docs/method.md."""
