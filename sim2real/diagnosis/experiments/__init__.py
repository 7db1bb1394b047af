"""What to record next: the motion that separates explanations which the logs leave open."""
