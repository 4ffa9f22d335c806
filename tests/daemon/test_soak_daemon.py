"""A soak of seconds: everything at once, and every promise that is not about time on this machine."""

import json

from rtctl.cli import main
from rtctl.soak.verdicts import GROWTH_KIB


def test_a_short_soak_keeps_its_promises(tmp_path, capsys):
    words = ["bench", "soak", "--minutes", "0.1", "--seed", "5", "--run-directory", str(tmp_path), "--json"]
    patient = [
        "--set",
        "backend.options.watchdog_ticks=2000",
        "--set",
        "safety.overrun_ticks=1000",
        "--set",
        "log.ring_rows=65536",
    ]
    main([*words, *patient])
    told = json.loads(capsys.readouterr().out)
    broken = {p["name"]: p["figures"] for p in told["promises"] if not p["good"] and not p["timed"]}
    assert broken == {}
    assert len(told["promises"]) == 9 + len(GROWTH_KIB)
    assert len(told["outages"]) == 1
    assert sum(s["sent"] for s in told["storms"]) > 1000
    reasons = {reason for s in told["storms"] for reason in s["reasons"]}
    assert {"accepted", "malformed", "unknown_key", "no_lease", "oversized"} <= reasons
    assert (tmp_path / "log-2.mcap").exists()
    assert json.loads((tmp_path / "soak.json").read_text()) == told
