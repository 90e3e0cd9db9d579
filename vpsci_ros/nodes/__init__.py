"""One ROS 2 node a file: each turns messages into one call of the core and the result into messages.

`topics` is the table of who speaks to whom and with which quality of service, `convert` the only place where
messages become arrays and back, `base` the form that all nodes share, `graph` starts and watches them as processes.
"""
