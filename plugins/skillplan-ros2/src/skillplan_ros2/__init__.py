"""The exporter `ros2`: the skills of a plan as joint trajectories of ROS 2, without ROS.

`swept` plans the trajectories.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

__version__ = "0.3.0"
