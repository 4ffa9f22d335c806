"""How both sides of the network use Zenoh."""

import json

import zenoh


def configure(mode: str, user: str = "", password: str = "") -> zenoh.Config:
    """A Zenoh configuration that finds nobody and is found by nobody: no multicast, no gossip."""
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": [],
        "connect/endpoints": [],
    }.items():
        config.insert_json5(key, json.dumps(value))
    if user:
        config.insert_json5("transport/auth/usrpwd/user", json.dumps(user))
        config.insert_json5("transport/auth/usrpwd/password", json.dumps(password))
    return config
