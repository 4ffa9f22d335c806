"""The doctor on machines made of files: a good one, one with each fault, and ones that do not tell."""

import json
import struct

import pytest

from rtctl.cli import main
from rtctl.cli.exit_codes import Exit
from rtctl.exchange.control import Grade
from rtctl.readiness import core, doctor, host, kernel, packages
from rtctl.readiness.facts import Facts, Unreadable
from rtctl.readiness.finding import Verdict
from rtctl.readiness.obtained import Obtained
from rtctl.settings import load

CPU = "sys/devices/system/cpu"
THP = "sys/kernel/mm/transparent_hugepage/enabled"
CLOCK = "sys/devices/system/clocksource/clocksource0/current_clocksource"
GOOD = {
    "proc/sys/kernel/osrelease": "6.1.0-20-rt-amd64\n",
    "proc/version": "Linux version 6.1.0-20-rt-amd64 #1 SMP PREEMPT_RT\n",
    "sys/kernel/realtime": "1\n",
    "proc/sys/kernel/sched_rt_runtime_us": "-1\n",
    "proc/sys/kernel/sched_rt_period_us": "1000000\n",
    THP: "always [madvise] never\n",
    CLOCK: "tsc\n",
    f"{CPU}/isolated": "2-3\n",
    f"{CPU}/online": "0-3\n",
    "proc/cmdline": "quiet isolcpus=2-3 nohz_full=2-3 rcu_nocbs=3 irqaffinity=0-2\n",
    f"{CPU}/cpu3/topology/thread_siblings_list": "3\n",
    f"{CPU}/cpu3/cpufreq/scaling_governor": "performance\n",
    f"{CPU}/cpu3/cpuidle/state0/name": "POLL\n",
    f"{CPU}/cpu3/cpuidle/state0/latency": "0\n",
    f"{CPU}/cpu3/cpuidle/state0/disable": "0\n",
    f"{CPU}/cpu3/cpuidle/state1/name": "C6\n",
    f"{CPU}/cpu3/cpuidle/state1/latency": "133\n",
    f"{CPU}/cpu3/cpuidle/state1/disable": "1\n",
    "proc/irq/16/smp_affinity_list": "0-2\n",
    "proc/irq/24/smp_affinity_list": "1\n",
    "proc/cpuinfo": "processor : 0\nflags : fpu tsc msr\n",
    "proc/stat": "cpu  9 9 9 9 9 9 9 9 0 0\ncpu3 1 0 2 300 0 0 0 17 0 0\n",
}
LOOKS = {
    "preemption": kernel.preemption,
    "throttling": kernel.throttling,
    "huge pages": kernel.huge_pages,
    "clock": kernel.clock_source,
    "isolation": lambda f: core.isolation(f, 3),
    "quiet": lambda f: core.quiet_kernel(f, 3),
    "siblings": lambda f: core.siblings(f, 3),
    "governor": lambda f: core.governor(f, 3),
    "idle": lambda f: core.idle_states(f, 3),
    "interrupts": lambda f: core.interrupts(f, 3),
    "hypervisor": host.hypervisor,
}


@pytest.fixture
def machine(tmp_path):
    def make(changes=None):
        for path, text in {**GOOD, **(changes or {})}.items():
            file = tmp_path / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.unlink(missing_ok=True)
            if text is not None:
                file.write_text(text)
        return Facts(tmp_path)

    return make


@pytest.mark.parametrize("look", LOOKS)
def test_a_good_machine_costs_nothing(machine, look):
    finding = LOOKS[look](machine())
    assert finding.verdict is Verdict.GOOD
    assert not finding.cost


@pytest.mark.parametrize(
    ("look", "changes", "found", "remedy"),
    [
        ("preemption", {"sys/kernel/realtime": None, "proc/version": "Linux 6.1 #1 SMP PREEMPT_DYNAMIC"}, "PREEMPT_DYNAMIC", "linux-image-rt"),
        ("preemption", {"sys/kernel/realtime": "0", "proc/version": "Linux 6.1 #1 SMP"}, "no preemption", "linux-image-rt"),
        ("preemption", {"sys/kernel/realtime": None, "proc/version": "PREEMPT_DYNAMIC", "sys/kernel/debug/sched/preempt": "none (voluntary) full"}, "voluntary", "linux-image-rt"),
        ("throttling", {"proc/sys/kernel/sched_rt_runtime_us": "500000"}, "500000 of 1000000", "sched_rt_runtime_us"),
        ("huge pages", {THP: "[always] madvise never"}, "always", "madvise"),
        ("clock", {CLOCK: "hpet"}, "hpet", "clocksource=tsc"),
        ("isolation", {f"{CPU}/isolated": ""}, "core 3", "isolcpus=managed_irq,domain,3"),
        ("isolation", {f"{CPU}/isolated": "0-2"}, "core 3", "isolcpus=managed_irq,domain,3"),
        ("quiet", {"proc/cmdline": "nohz_full=3"}, "rcu_nocbs", "rcu_nocbs=3"),
        ("quiet", {"proc/cmdline": "xnohz_full=3 rcu_nocbs=all"}, "nohz_full", "nohz_full=3"),
        ("siblings", {f"{CPU}/cpu3/topology/thread_siblings_list": "1,3"}, "with 1", "smt/control"),
        ("governor", {f"{CPU}/cpu3/cpufreq/scaling_governor": "powersave"}, "powersave", "performance"),
        ("idle", {f"{CPU}/cpu3/cpuidle/state1/disable": "0"}, "C6, 133 us", "idle-set"),
        ("interrupts", {"proc/irq/24/smp_affinity_list": "0-3"}, "1 of 2 may come to core 3: 24", "irqaffinity=0,1,2"),
        ("hypervisor", {"proc/cpuinfo": "flags : fpu hypervisor"}, "yes", "machine of its own"),
    ],
)  # fmt: skip
def test_what_makes_the_loop_late_is_found_with_what_mends_it(machine, look, changes, found, remedy):
    finding = LOOKS[look](machine(changes))
    assert finding.verdict is Verdict.COSTS
    assert found in finding.found
    assert finding.cost
    assert remedy in finding.remedy


@pytest.mark.parametrize(
    ("look", "changes"),
    [
        ("preemption", {"sys/kernel/realtime": None, "proc/version": None}),
        ("throttling", {"proc/sys/kernel/sched_rt_runtime_us": "much"}),
        ("huge pages", {THP: "always madvise never"}),
        ("clock", {CLOCK: None}),
        ("isolation", {f"{CPU}/isolated": "2-x"}),
        ("quiet", {"proc/cmdline": None}),
        ("quiet", {"proc/cmdline": "nohz_full=all rcu_nocbs=oops"}),
        ("siblings", {f"{CPU}/cpu3/topology/thread_siblings_list": None}),
        ("governor", {f"{CPU}/cpu3/cpufreq/scaling_governor": None}),
        ("idle", {f"{CPU}/cpu3/cpuidle/state1/latency": ""}),
        ("interrupts", {"proc/irq/16/smp_affinity_list": None, "proc/irq/24/smp_affinity_list": None}),
        ("interrupts", {"proc/irq/16/smp_affinity_list": "?", "proc/irq/24/smp_affinity_list": "?"}),
        ("hypervisor", {"proc/cpuinfo": ""}),
    ],
)
def test_what_is_not_told_is_never_a_number(machine, look, changes):
    facts = machine(changes)
    with pytest.raises(Unreadable) as told:
        LOOKS[look](facts)
    assert str(told.value).startswith("/"), "the file is named"
    assert doctor._look("it", lambda: LOOKS[look](facts)).verdict is Verdict.UNKNOWN


def test_a_closed_file_is_not_an_absent_one(machine, monkeypatch):
    def closed(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    facts = machine()
    monkeypatch.setattr("pathlib.Path.read_text", closed)
    with pytest.raises(Unreadable, match="permission denied"):
        kernel.clock_source(facts)


def test_time_that_the_host_steals_and_the_firmware_takes_show_as_differences(machine, tmp_path):
    facts = machine()
    assert host.stolen_ticks(facts, 3) == 17
    assert host.steal(17, 17, 1.0).verdict is Verdict.GOOD
    assert "4 ticks" in host.steal(17, 21, 1.0).found
    with pytest.raises(Unreadable, match="cpu9"):
        host.stolen_ticks(facts, 9)
    with pytest.raises(Unreadable, match="steal"):
        host.stolen_ticks(machine({"proc/stat": "cpu3 1 2 3"}), 3)
    register = tmp_path / "dev/cpu/3/msr"
    register.parent.mkdir(parents=True)
    register.write_bytes(bytes(0x34) + struct.pack("<Q", 41))
    assert host.smi_count(facts, 3) == 41
    assert host.smi(0xFFFFFFFF, 1, 1.0).found.startswith("2 in"), "the register wraps"
    register.write_bytes(bytes(10))
    with pytest.raises(Unreadable):
        host.smi_count(facts, 3)


def test_the_installed_packages_fit():
    assert [f.verdict for f in packages.versions()] == [Verdict.GOOD]


def test_a_package_of_another_version_or_none_is_named(monkeypatch):
    monkeypatch.setattr(packages.metadata, "requires", lambda _: ["numpy>=99", "nowhere-to-be-found>=1"])
    found = packages.versions()
    assert [(f.name, f.verdict) for f in found] == [
        ("package numpy", Verdict.COSTS),
        ("package nowhere-to-be-found", Verdict.COSTS),
    ]


def test_a_machine_that_tells_nothing_is_unknown_in_all(tmp_path, monkeypatch):
    monkeypatch.setattr(doctor, "obtain", lambda _: Obtained(Grade.BEST_EFFORT, ()))
    found = doctor.examine(load("planar-sim", ["loop.cpu=3"]), Facts(tmp_path), watched_s=0.0).findings
    silent = [f for f in found if f.verdict is Verdict.UNKNOWN]
    assert len(silent) == len(LOOKS) + 2
    assert all("could not be read: /" in f.found for f in silent)


def test_the_command_gives_the_grade_of_the_real_time_process_itself(capsys):
    code = main(["doctor", "planar-sim", "--json"])
    told = json.loads(capsys.readouterr().out)
    obtained = [f for f in told["findings"] if f["name"].startswith(doctor.OBTAINED)]
    assert len(obtained) == 8
    assert all(doctor.COST_OF[f["name"].removeprefix(doctor.OBTAINED)] for f in obtained)
    granted = all(f["verdict"] == "good" for f in obtained)
    assert told["grade"] == ("rt" if granted else "best-effort")
    assert code == (Exit.OK if granted else Exit.FAILED)
