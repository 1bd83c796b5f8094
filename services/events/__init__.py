"""Events around people: they come, leave, enter zones, come near the robot."""
