"""Programs for those who build people4d; nothing here runs on a robot."""
