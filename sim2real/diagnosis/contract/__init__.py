"""The policy's interface: is what it saw and did what it was trained on?"""
