"""The page of a capacity study."""
