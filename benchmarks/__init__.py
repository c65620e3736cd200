"""What the simulator and the learner cost, measured as ratios within one run."""
