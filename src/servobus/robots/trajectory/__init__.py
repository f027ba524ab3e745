"""Joint-space trajectories: where each joint shall be at which time, within its limits. Pure mathematics."""
