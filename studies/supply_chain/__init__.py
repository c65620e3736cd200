"""What this project depends on, and what is built of it."""
