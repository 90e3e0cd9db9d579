"""Conversion of messages between bytes and arrays, without ROS.

`layout` says which arrays a message holds, `decoder` reads any message by its definition. What every tick sends is
packed, unpacked and checked by hand (`header`, `world_state`, `answers`, `odometry`, `markers`).
"""
