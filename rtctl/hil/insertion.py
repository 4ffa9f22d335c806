"""The insertion of the settings on the plant itself: what the bench is measured by."""

from rtctl.recording import Recording
from rtctl.settings import Settings, from_table, table_of
from rtctl.simulation import simulate


def plant_settings(settings: Settings) -> Settings:
    """The same controller on the plant that is behind the emulated devices of `settings`."""
    table = table_of(settings)
    table["backend"] = {"name": "plant", "options": dict(settings.backend.options.get("rig", {}).get("plant", {}))}
    return from_table(table)


def on_the_plant(settings: Settings, seed: int) -> Recording:
    """The whole insertion in lockstep. Raises RtctlError if it does not come to its end."""
    simulation = simulate(plant_settings(settings), seed)
    if simulation.failure is not None:
        raise simulation.failure
    return simulation.recording
