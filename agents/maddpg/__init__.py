"""MADDPG: algorithm, policy and replay buffer."""
