"""Plans as GeoJSON, as KML and as a page."""
