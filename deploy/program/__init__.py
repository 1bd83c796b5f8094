"""The pipeline and cameras for user programs, see people4d_robot."""
