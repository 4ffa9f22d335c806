"""The scope: captures of chosen signals at the full rate, around a trigger.

It is a pure state machine over rows of the record (:mod:`rtctl.scope.scope`). The gateway, which drains every record
anyway, feeds it in a running controller (:mod:`rtctl.gateway.scopes`); a log feeds it afterwards
(:mod:`rtctl.scope.offline`). The loop knows nothing of it.
"""
