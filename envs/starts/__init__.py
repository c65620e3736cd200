"""What an episode begins with: a place, its users, and where UAVs start."""
