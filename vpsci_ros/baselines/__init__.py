"""The other models of Table 9, as far as they are a matter of how a history is encoded and of what is learned."""
