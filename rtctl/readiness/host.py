"""What works behind the kernel's back: a hypervisor, and the firmware's own interrupts (SMI)."""

from rtctl.readiness.facts import Facts, Unreadable
from rtctl.readiness.finding import Finding, costs, good

SMI_COUNT_MSR = 0x34
"""Of Intel processors: system management interrupts since reset, in the lower 32 bits."""
STEAL = 8
"""Column of /proc/stat, the first is the name."""


def hypervisor(facts: Facts) -> Finding:
    """Whether this is a machine at all."""
    name, text = "virtual machine", facts.text("proc/cpuinfo")
    if not text:
        raise Unreadable("/proc/cpuinfo: it is empty")
    flags = next((line for line in text.splitlines() if line.startswith("flags")), "").split()
    if "hypervisor" not in flags:
        return good(name, "no hypervisor shows")
    return costs(
        name, "yes", "the host stops the loop for milliseconds whenever it likes", "run on a machine of its own"
    )


def stolen_ticks(facts: Facts, core: int) -> int:
    """Time the host took from the core since boot [1/100 s as a rule]. Raises Unreadable."""
    for line in facts.text("proc/stat").splitlines():
        words = line.split()
        if words and words[0] == f"cpu{core}":
            try:
                return int(words[STEAL])
            except (IndexError, ValueError):
                raise Unreadable(f"/proc/stat: no steal in {line[:60]!r}") from None
    raise Unreadable(f"/proc/stat: no line of cpu{core}")


def steal(before: int, after: int, seconds: float) -> Finding:
    """What the host took in between two looks."""
    name, taken = "stolen time", after - before
    if taken == 0:
        return good(name, f"none in {seconds:g} s")
    return costs(name, f"{taken} ticks of the kernel in {seconds:g} s", "the loop stood still for that long", "give the virtual machine a core of its own, or take a machine")  # fmt: skip


def smi_count(facts: Facts, core: int) -> int:
    """System management interrupts since reset. Raises Unreadable where the processor does not tell, or not to us."""
    return int.from_bytes(facts.bytes_at(f"dev/cpu/{core}/msr", SMI_COUNT_MSR, 8), "little") & 0xFFFFFFFF


def smi(before: int, after: int, seconds: float) -> Finding:
    """What the firmware took in between two looks."""
    name, count = "firmware interrupts (SMI)", (after - before) & 0xFFFFFFFF
    if count == 0:
        return good(name, f"none in {seconds:g} s")
    return costs(name, f"{count} in {seconds:g} s", "each stops every core for 10 to 1000 us, and no kernel can prevent it", "switch off power management and legacy USB in the firmware's setup")  # fmt: skip
