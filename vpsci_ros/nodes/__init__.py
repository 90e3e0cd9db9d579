"""ROS 2 nodes, one a file: each turns messages into a call of the core library, and the result into messages.

In reading order:

* `topics`: the graph as a table: each topic with type, publishers, subscribers and quality of service
* `world_simulator`: the world as a node: publishes tick k, waits for the answers to tick k, moves on to tick k + 1
* `world_outputs`: the world's publications: state, time, events, transitions
* `respondents`: the nodes and driving systems that answer the world's ticks: their messages, and whose are missing
* `safety_monitor`: the CurvTTC safety monitor: answers every WorldState with CurvTTC and distance of each parallel
* `agent_policy`: a policy as a node: at each policy frame
* `perception`: perception as a node: publishes the pedestrians with the errors of a sensor and a tracker
* `recorder`: the recorder: writes the topics that `topics` lists for it to a rosbag2 folder with MCAP storage
* `replayer`: the replayer: publishes the recorded messages of a bag at the pace of their log times, times `rate`
* `learner`: the learner: stage 1 from real near misses, or stage 2 from `/replay` while the graph runs
* `example_ads`: an example of a driving system as a node
* `example_driver`: the example's driver, without ROS: it keeps a speed, and brakes if it would come near a pedestrian
* `base`: the base class of a graph's nodes, with parameters from configuration classes
* `node_config`: parameters that only nodes have, and the configuration classes of each node
* `intake`: the input of a node: its subscriptions, rejected messages, and the nodes that publish to it
* `output`: a publisher of a graph's node that waits, before its first message
* `convert`: conversion of arrays to ROS messages; `wire.layout` defines their content
* `status`: the report of a node, published on `/diagnostics` and, in a graph, sent through a pipe
* `graph`: a graph of nodes as processes, which are started, watched and stopped together
* `watch`: watching a run of a graph: the time without progress, and its progress on standard error
* `failures`: the reasons for which a run of a graph fails, as sentences, from the nodes' reports
* `domain`: environment of the middleware: the domain, discovery, security, and the settings of Fast DDS
* `shared_memory`: shared memory that a killed process of Fast DDS has left behind
* `self_test`: whether the middleware works here: a node in its own domain publishes a message and waits for it
* `entry`: the executables of `ros2 run vpsci_ros`, one for each node; they import quickly
"""
