"""What policies and checkpoints are stored with: checked JSON and tensors, written in one step."""
