"""Conversion of messages between bytes and arrays, without ROS.

`layout` lists the arrays of each message, `decoder` reads any message by its definition. The messages of every tick
have hand-written code that packs, unpacks and checks them (`header`, `world_state`, `answers`).
"""
