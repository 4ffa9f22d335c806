"""What crosses between the real-time process and the gateway: one segment of shared memory, no lock, no wait.

Records go out through a ring, commands come in through a mailbox, plans and parameter sets through staging
slots, and everything else is a control word. Each piece is an array of 64-bit words with one writer, so that
either side may die at any instruction and the other one never waits for it.

The kernels belong inside other kernels. Called from Python they work as well, but to recognise the type of one
record costs the interpreter microseconds, where the kernel itself takes tens of nanoseconds.
"""
