"""ROS 2 nodes, one a file: each turns messages into a call of the core library, and the result into messages.

`topics` is the table of topics with their publishers, subscribers and quality of service, `base` the form that all
nodes share. `convert` makes message objects of arrays; `vpsci_ros.wire` writes the messages of every tick as bytes.
`graph` starts the nodes as processes, `status` is the report of each node, and `failures` detects failed runs.
"""
