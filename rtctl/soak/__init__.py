"""A soak: the daemon in real time under random commands, client storms and gateway kills, and what must still hold."""
