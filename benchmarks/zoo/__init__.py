"""Models that others made, and ones with every part MJCF has, through the whole diagnosis."""
