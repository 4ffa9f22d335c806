"""The second process: it drains the records into the log and stands between the network and the mailbox.

Run it with ``python -m rtctl.gateway``. One thread drains (:mod:`rtctl.gateway.process`); requests come in on Zenoh's
threads, wait in bounded queues, and are answered by workers (:mod:`rtctl.gateway.network`). The tick never waits for
any of them.
"""
