"""The parallel kinematic machine: its kinematics and reach; never a task."""
