"""Events of people: appearance, disappearance, zones, distance to the robot."""
