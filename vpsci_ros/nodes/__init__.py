"""ROS 2 nodes, one in each file: each turns messages into one call of the core, and its result into messages.

`topics` is the table of topics with their publishers, subscribers and quality of service, `convert` the only place
where arrays become messages, `base` the form that all nodes share. `graph` starts the nodes as processes, `status` is
the report of each node, and `failures` has every reason for which a run fails.
"""
