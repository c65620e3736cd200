"""What the program has to bear: kills, faults, fuzzed input, large fleets."""
