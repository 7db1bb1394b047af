"""What a trained policy is worth: grids of robots, named robots, studies of many runs, films."""
