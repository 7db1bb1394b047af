"""What to record next: the motion that tells apart explanations which the logs leave open."""
