"""Methods flown over the same topologies that no training has seen."""
