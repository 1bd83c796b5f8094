"""Extrinsics and clocks of several cameras from walking people, see docs/method.md."""
