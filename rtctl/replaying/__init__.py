"""Replays at scale: where two differ, many runs at once, other revisions, and logs small enough for a repository."""
