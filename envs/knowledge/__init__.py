"""What UAVs know in flight, and what they can conclude from it."""
