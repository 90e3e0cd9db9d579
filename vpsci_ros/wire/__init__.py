"""Messages as bytes and as arrays, without ROS: a node gets bytes and gives bytes.

`layout` says which arrays a message holds, `decoder` reads any message by its definition. What every tick sends is
packed, unpacked and checked by hand (`header`, `world_state`, `answers`).
"""
