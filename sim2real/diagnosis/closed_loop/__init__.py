"""The policy plays in the corrected simulator: does it see there what it saw on the robot?"""
