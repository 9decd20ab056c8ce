"""Imported once by the server that commands are forked from: what libraries do at their first use, done."""

import rosbags.typesys
from numba import njit

# Numba looks its own functions up at the first compilation of a process; rosbags makes a class per message type.
njit(lambda x: x + 1.0)(1.0)
for store in (rosbags.typesys.Stores.ROS1_NOETIC, rosbags.typesys.Stores.ROS2_HUMBLE):
    rosbags.typesys.get_typestore(store)
