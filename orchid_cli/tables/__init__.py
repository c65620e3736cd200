"""What is shown when a command has its results."""
