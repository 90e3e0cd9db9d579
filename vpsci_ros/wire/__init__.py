"""Messages as bytes and as arrays, without ROS.

`layout` says which arrays a message holds, `decoder` reads any message by its definition, `received` checks what came
from a topic. What every tick sends is packed and unpacked by hand (`header`, `world_state`, `answers`), and
`padding` clears the bytes between the fields of a serialized message.
"""
