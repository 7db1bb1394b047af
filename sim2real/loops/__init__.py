"""Logic that needs several rooms: from a robot's episodes to a better policy."""
