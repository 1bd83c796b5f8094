"""The pipeline and cameras for programs that import them: see people4d_robot."""
