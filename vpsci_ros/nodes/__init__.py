"""ROS 2 nodes, one a file: each turns messages into a call of the core library, and the result into messages.

`topics` is the table of topics with their publishers, subscribers and quality of service, `convert` the only place
where arrays become messages, `base` the form that all nodes share. `graph` starts the nodes as processes, `status` is
the report of each node, and `failures` has every reason for which a run fails.
"""
