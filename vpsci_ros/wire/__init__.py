"""Conversion of messages between bytes and arrays, without ROS.

What every tick sends is packed, unpacked and checked by hand.

In reading order:

* `layout`: the layout of the node graph's messages, without ROS: their arrays, and the records made from them
* `header`: the first bytes of a serialized message of `vpsci_msgs`: encapsulation, header, tick
* `world_state`: conversion of a serialized `vpsci_msgs/WorldState` to records and back
* `answers`: conversion of serialized `vpsci_msgs/SafetyState` and `vpsci_msgs/AgentAction` to arrays and back
* `events`: events of episodes as a serialized `vpsci_msgs/EpisodeEvent`, byte by byte as ROS 2 writes them
* `odometry`: motions as serialized `nav_msgs/Odometry` and `tf2_msgs/TFMessage`, byte by byte as ROS 2 writes them
* `markers`: the world as RViz and Foxglove draw it, as a serialized `visualization_msgs/MarkerArray`
* `decoder`: conversion of serialized messages to objects, by the definitions in the bag
"""
