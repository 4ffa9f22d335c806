"""The settings of a bench made into others: in lockstep, and on the plant itself, which is what it is measured by."""

from dataclasses import replace

from rtctl.recording import Recording
from rtctl.settings import Settings, from_table, table_of
from rtctl.simulation import simulate


def in_lockstep(settings: Settings) -> Settings:
    """The same drivers and emulators in one process, without a clock: the backend "rig"."""
    return replace(settings, backend=replace(settings.backend, name="rig"))


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
