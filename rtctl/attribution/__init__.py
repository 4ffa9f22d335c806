"""Who held the loop: from the records around a tick over budget, and what the system counted meanwhile, to words.

Everything in here is a function of its arguments; :mod:`rtctl.gateway.witness` looks at the machine.
"""
