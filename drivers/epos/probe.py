"""What can be seen of a drive by SDO, without moving anything."""

from drivers.epos.objects import FAULT_CODE, STATUSWORD_OBJECT, process_data, safety_settings
from drivers.epos.options import EposOptions, NodeOptions
from drivers.epos.service import Service
from drivers.epos.states import STATE_OF, State
from hal.device import Finding, Site
from hal.errors import BackendError

POSITION_OBJECT = 0x6064


def look_at(service: Service, bus: EposOptions, node: NodeOptions, site: Site) -> list[Finding]:
    """One drive; a node that does not answer is one bad finding."""
    who = f"node {node.node} (axis {node.axis})"
    try:
        state = STATE_OF[service.read(node.node, STATUSWORD_OBJECT, 0) & 0x7F]
        code = service.read(node.node, FAULT_CODE, 0)
        position = service.read(node.node, POSITION_OBJECT, 0, signed=True)
        wrong = [
            f"{setting} is {held} instead of {setting.value}"
            for setting in _final(safety_settings(bus, node, site) + process_data(node))
            if not setting.held_by(held := service.read(node.node, setting.index, setting.sub, setting.size < 0))
        ]
    except BackendError as error:
        return [Finding(who, error.what, False, error.remedy)]
    return [
        Finding(f"{who}: state", state.name.lower(), state not in (State.FAULT, State.REACTING, State.ENABLED), "clear the cause of the fault, then acknowledge"),
        Finding(f"{who}: last fault", f"{code:04X}", code == 0, "look the code up in the drive's manual"),
        Finding(f"{who}: encoder", f"{position} counts; turn the shaft by hand and look again", True),
        Finding(f"{who}: settings", "; ".join(wrong) or "all held", not wrong, "close and open the backend, which writes them anew"),
    ]  # fmt: skip


def _final(settings: list) -> list:
    """Of an object that is written twice only the last value is held."""
    return list({(s.index, s.sub): s for s in settings}.values())
