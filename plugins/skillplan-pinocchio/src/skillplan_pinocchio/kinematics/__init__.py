"""Kinematics of any serial arm: forward, and inverse by closed form or numerically."""
