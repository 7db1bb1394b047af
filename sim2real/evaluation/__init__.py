"""Evaluate trained policies: grids of robots, named robots, studies of many runs, films."""
