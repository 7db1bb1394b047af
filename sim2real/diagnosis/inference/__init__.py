"""One likelihood judges every explanation of a gap: of the robot, of the log and of the world."""
