"""The exporter `ros2`: the skills of a plan as joint trajectories of ROS 2, without ROS.

It finds no path and times none itself: what `swept` plans is what it writes.
"""

__version__ = "0.2.0"
