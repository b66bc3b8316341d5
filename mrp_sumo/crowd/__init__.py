"""People in the free space of a building: where they can walk, which way, and how they do."""
