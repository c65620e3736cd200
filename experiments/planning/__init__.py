"""Plans for real places: from where people are to where drones circle."""
