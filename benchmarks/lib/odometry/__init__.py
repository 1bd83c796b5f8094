"""Parts of `benchmarks.odometry`: rides of robots and cars, and tables of trackers on them."""
