"""Has the robot changed between two sets of logs?"""
