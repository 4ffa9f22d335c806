"""Driving the robot by hand: devices publish twist, buttons and deadman; a bridge follows while the deadman is held.

device -> Publisher -> rtctl/<robot>/operator/twist -> Link (is the deadman level and fresh?) -> Follower -> servo_cv
"""
