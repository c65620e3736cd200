"""MAPPO: algorithm, policy and rollout buffer."""
