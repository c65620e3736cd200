"""The network as PettingZoo, Gymnasium and SB3 environments."""
