"""What returns actions: rules, the planner, and learned policies."""
