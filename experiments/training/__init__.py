"""One training run: learner, loop, checkpoints, trackers."""
