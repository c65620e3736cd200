"""Files of people, areas and zones, read strictly."""
